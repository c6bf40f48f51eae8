// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/geometry/contour.hpp>

namespace telefab {

/// Rings of one layer by kind.
struct ContourCount {
  int outers = 0;
  int holes = 0;
  friend bool operator==(const ContourCount&, const ContourCount&) = default;
};

/// Why a layer is doubtful. Numbers go over the wire: never renumber. Behind each: which numbers of Doubt it uses.
enum class DoubtReason : std::uint8_t {
  ContoursLeftOut = 1,      ///< open contours are missing: size_mm of the gap
  GapBridged = 2,           ///< a gap of size_mm is closed by the side that all samples together tell
  ContourOpen = 3,          ///< a contour does not close
  RepeatsLayer = 4,         ///< the base was closed by repeating layer `number`
  ContoursCross = 5,        ///< contours cross or touch
  NestingWrong = 6,         ///< rings do not alternate as solid and hole
  ContourMissing = 7,       ///< the surface passes through the plane, but no contour was found
  SurfaceUncovered = 8,     ///< the surface at `number` samples reaches the plane beside every contour
  SamplesOffSurface = 9,    ///< `number` samples near the plane lie on no surface and beside no contour
  KernelsDisagree = 10,     ///< a kernel of size_mm finds `found`, one of other_mm finds `other`
  EdgeTooSharp = 11,        ///< an edge sharper than the scan shows begins or ends near this height
  EulerDiffers = 12,        ///< critical points predict another Euler number than the contours have (both: certificate)
  MethodsDisagree = 13,     ///< at a critical height marching finds `found`, the grid `other`
  NotCrossChecked = 14,     ///< too near to a critical height to be checked by one method alone
  RingTooSmall = 15,        ///< a ring smaller than the coding lattice was left out
  CrossOnLattice = 16,      ///< contours cross or touch on the coding lattice
  WindingDisagrees = 17,    ///< at `number` points of contours the winding number tells inside and outside otherwise
  EarlierRelease = 18,      ///< a file of an earlier release says so in words, which are not kept
  CoordinatesRounded = 19,  ///< the coordinates of the scan are rounded to size_mm, coarse against its spacing
  FacesEmpty = 20,          ///< the faces of the file carry no points, and points are all that is taken
  CriticalInGap = 21,  ///< a contour begins, ends, parts or joins where nothing is measured, within size_mm of here
  SheetsDoubled = 22,  ///< the scan shows two sheets size_mm apart where one surface ought to be
};
inline constexpr DoubtReason kLastDoubtReason = DoubtReason::SheetsDoubled;
/// One word with hyphens, for programs: "contours-left-out", ...
[[nodiscard]] std::string_view name_of(DoubtReason reason);

/// What does not fit in one layer. Numbers that the reason does not use are zero.
struct Doubt {
  DoubtReason reason = DoubtReason::ContourOpen;
  std::optional<Point2> place = std::nullopt;  ///< where the first disagreement lies
  std::uint32_t number = 0;
  double size_mm = 0;
  double other_mm = 0;
  ContourCount found = {};
  ContourCount other = {};
  friend bool operator==(const Doubt&, const Doubt&) = default;
};

/// What the slicer vouches for in one layer.
struct LayerCertificate {
  /// Numbers go over the wire: never renumber.
  enum class Verdict : std::uint8_t {
    Unchecked = 1,  ///< nobody looked (contours imported from elsewhere)
    Measured = 2,   ///< certified: the topology is vouched for, and samples lie beside all of the contours
    Doubtful = 3,   ///< flagged: something does not agree; see `doubt`
    Completed = 4,  ///< certified: the topology is vouched for; stretches of contours are continued across gaps
  };
  /// How the contours were found.
  enum class Method : std::uint8_t { Imported = 1, Grid = 2, Reeb = 3 };
  /// What vouches for count and nesting of the contours.
  enum class Ground : std::uint8_t {
    None = 1,         ///< nothing
    Graph = 2,        ///< the critical points below predict the same counts
    TwoMethods = 3,   ///< marching and grid found the same
    WindingTest = 4,  ///< the winding number of the samples agrees along all contours
  };

  Verdict verdict = Verdict::Unchecked;
  Method method = Method::Imported;
  Ground ground = Ground::None;
  std::optional<std::int32_t> predicted_euler;  ///< outer minus hole rings, from the critical points below this layer
  std::int32_t measured_euler = 0;              ///< outer minus hole rings found
  std::optional<Doubt> doubt;                   ///< the gravest; only where the verdict is Doubtful
  /// Rings too small to be printed that were left out after the layer was judged: the counts above have them.
  std::uint32_t specks = 0;

  /// Count (with the specks), nesting, closedness, coverage and absence of crossings are vouched for.
  [[nodiscard]] bool is_certified() const { return verdict == Verdict::Measured || verdict == Verdict::Completed; }
  /// The layer lacks contours of the object: a part printed from it lacks them too.
  [[nodiscard]] bool is_incomplete() const;
  /// Makes the layer doubtful.
  void flag(Doubt why);
  friend bool operator==(const LayerCertificate&, const LayerCertificate&) = default;
};
[[nodiscard]] std::string_view name_of(LayerCertificate::Verdict verdict);
[[nodiscard]] std::string_view name_of(LayerCertificate::Ground ground);

/// The doubt in words, for people; empty where there is none.
[[nodiscard]] std::string sentence_of(const LayerCertificate& certificate);

}  // namespace telefab
