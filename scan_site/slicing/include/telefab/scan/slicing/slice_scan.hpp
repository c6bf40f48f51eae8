// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/progress.hpp>
#include <telefab/base/result.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/placing/standing.hpp>
#include <telefab/scan/placing/turn.hpp>
#include <telefab/scan/slicing/prepare_scan.hpp>
#include <vector>

namespace telefab::scan {

/// How contours are found: marched from the Reeb graph, by marching squares, or marched where the result can be
/// certified and by squares where not.
enum class TraceMethod : std::uint8_t { Auto = 1, Reeb = 2, Grid = 3 };
/// "auto", "reeb", "grid"; InvalidInput lists them.
[[nodiscard]] Result<TraceMethod> trace_method_from(std::string_view name);

/// Axis of the scan's frame that changes its sign.
enum class MirrorAxis : std::uint8_t { X = 1, Y = 2, Z = 3 };
/// "x", "y", "z"; InvalidInput lists them.
[[nodiscard]] Result<MirrorAxis> mirror_axis_from(std::string_view name);
/// "X,Y,Z", the factors of PlacementOptions::axis_scale. Fails: InvalidInput.
[[nodiscard]] Result<Vec3> axis_scale_from(std::string_view text);
/// "X,Y", millimetres on the platform (PlacementOptions::position_mm). Fails: InvalidInput.
[[nodiscard]] Result<Point2> position_from(std::string_view text);

/// How large a scan is made, and how it stands: mirrored, then turned, then scaled as a whole, then by axis, then
/// moved. Of height, scale and fit at most one; none: the file's own size.
struct PlacementOptions {
  std::optional<double> height_mm;   ///< > 0; the scan's z extent becomes this, before axis_scale
  std::optional<double> scale;       ///< > 0; millimetres per unit of the file
  std::optional<double> unit_mm;     ///< > 0; millimetres in a unit of the file; none: as the file states it, or one
  bool fit = false;                  ///< as large as the machine holds, with supports and a margin of 1 % on every side
  std::optional<MirrorAxis> mirror;  ///< the other hand of the object: this axis of the scan changes its sign
  Turn turn;                         ///< of the mirrored scan: heights are along what is then z
  std::optional<StandFor> stand_for;  ///< the turn is chosen for this, whatever `turn` says
  /// [0.8, 1.25] each; along x, y and z of the build frame, against shrinkage. Sizes asked for are those before.
  Vec3 axis_scale = Vec3::Ones();
  std::optional<Point2> position_mm;  ///< of the middle of the part's box on the platform; none: its middle
  /// Fails: InvalidInput.
  [[nodiscard]] Result<void> validate() const;
};

/// A way to stand that was chosen from all directions.
struct ChosenStanding {
  StandFor goal = StandFor::Supports;
  Standing standing;
  std::optional<StandingFigures> as_in_file;  ///< none where it does not fit that way
};
/// What was chosen and why, for people.
[[nodiscard]] std::string sentence_of(const ChosenStanding& chosen);
/// One JSON object, fixed key order: goal, source and figures of the chosen way, and those of the file's own.
[[nodiscard]] std::string to_json(const ChosenStanding& chosen);

/// What was done to the scan besides scaling it as a whole, for people: "turned by 90,0,0 degrees, mirrored in x".
/// Empty where nothing was.
[[nodiscard]] std::string sentence_of(const PlacementOptions& placement);
/// One JSON object in the words that ask for it: rotate, mirror, scale_axes, position_mm; the middle one and the last
/// where they are set.
[[nodiscard]] std::string to_json(const PlacementOptions& placement);

/// One of `count` shares of layers, as equal as they can be; 1 has the lowest. Where there are more shares than layers,
/// some have none.
struct LayerShare {
  std::uint32_t index = 1;  ///< [1, count]
  std::uint32_t count = 1;  ///< [1, kMaxLayers]
  friend bool operator==(const LayerShare&, const LayerShare&) = default;
};
/// "I/N". Fails: InvalidInput.
[[nodiscard]] Result<LayerShare> layer_share_from(std::string_view text);
/// "FIRST:LAST", both counted from 0 and both cut (SliceRequest::layers). Fails: InvalidInput.
[[nodiscard]] Result<std::array<std::uint32_t, 2>> layers_from(std::string_view text);

/// Everything that decides the layers.
struct SliceRequest {
  MachineProfile machine;
  IntakeOptions intake;  ///< which points are the object; strays stay where `mls` keeps its outliers
  PlacementOptions placement;
  std::optional<double> layer_mm;  ///< (0, 1]; none: the machine's layer thickness
  TraceMethod method = TraceMethod::Auto;
  MlsOptions mls;
  bool complete = true;               ///< gaps of the scan are closed before it is sliced
  bool flat_base = false;             ///< an underside without samples is no fault: the part ends flat at the platform
  std::optional<double> most_gap_mm;  ///< > 0; how far from the nearest sample. None: a quarter of the part's diagonal
  /// > 0; the scan is a sheet or relief seen from one side: the part is this thick, behind what was scanned. None: a
  /// body.
  std::optional<double> thickness_mm;
  std::optional<double> chord_mm;  ///< (0, 1]; none: a tenth of the pixel pitch
  double speck_px2 = 0.5;          ///< [0, 100]; rings of less area, in pixels, are left out (see leave_specks_out)
  unsigned threads = 0;            ///< 0: one a core
  std::optional<std::array<std::uint32_t, 2>> layers;  ///< first and last layer to be cut; none: all
  std::optional<LayerShare> share;                     ///< of these layers only this share is cut; none: all of them
  [[nodiscard]] Result<void> validate() const;
  /// Along x, y and z of the build frame: what was asked for, and what makes good the shrinkage that the machine's
  /// resin states. Layers are cut of the scan made so much larger, so that they have the right place once they have
  /// shrunk.
  [[nodiscard]] Vec3 drawn_axis_scale() const {
    const std::array<double, 3> drawn = machine.drawn_scale();
    return placement.axis_scale.cwiseProduct(Vec3{drawn[0], drawn[1], drawn[2]});
  }
};

/// "flat" or "scanned" (SliceRequest::flat_base). Fails: InvalidInput.
[[nodiscard]] Result<void> base_as(std::string_view text, SliceRequest& request);
/// "auto", "off", or a distance in millimetres (SliceRequest::complete, most_gap_mm). Fails: InvalidInput.
[[nodiscard]] Result<void> complete_gaps_as(std::string_view text, SliceRequest& request);

/// Layers from the first to the one before `end`.
struct LayerRange {
  std::uint32_t first = 0, end = 0;
  [[nodiscard]] std::uint32_t count() const { return end - first; }
  friend bool operator==(const LayerRange&, const LayerRange&) = default;
};
/// The layers of one share of them.
[[nodiscard]] LayerRange share_of(const LayerRange& range, const LayerShare& share);

/// What a request has to be cut of all layers there are. Fails: InvalidInput (there are no such layers).
[[nodiscard]] Result<LayerRange> range_of(const SliceRequest& request, std::uint32_t layer_count);

/// A layer that is not certified.
struct FlaggedLayer {
  LayerIndex layer;
  double z_mm = 0;
  LayerCertificate certificate;
  double doubtful_share = 1;  ///< [0, 1] of the length of its contours; 1 where it has none
};

/// A gap in the scan that left a contour open.
struct LayerGap {
  LayerIndex layer;
  double z_mm = 0;
  Point2 place;
  double size_mm = 0;
  bool bridged = false;  ///< closed by the side that all samples tell; false: the contour was left out
};

/// What the samples of a scan leave open. The area vectors of a closed surface add up to nothing (divergence theorem):
/// what is missing from the samples' own sum belongs to surface that none of them shows.
struct Openness {
  double seen_mm2 = 0;              ///< area the samples stand for
  Vec3 missing_mm2 = Vec3::Zero();  ///< area vector of the surface not seen, outward; build frame
  [[nodiscard]] double share() const { return seen_mm2 > 0 ? missing_mm2.norm() / seen_mm2 : 0; }
};

/// What was added to the scan where it has gaps.
struct CompletionSummary {
  std::size_t rim_samples = 0;  ///< measured samples beside which the surface ends
  std::size_t virtual_samples = 0;
  double largest_gap_mm = 0;    ///< largest distance of one of them to the nearest measured sample
  double largest_error_mm = 0;  ///< it may be wrong by so much
};

/// Rings too small to be printed that no layer holds any more.
struct SpeckSummary {
  double least_mm2 = 0;  ///< what has less area is a speck
  std::uint64_t rings = 0;
  double largest_mm2 = 0;          ///< of those left out
  std::vector<LayerIndex> layers;  ///< that had some, from below
};

struct SliceReport {
  StackHeader header;
  std::size_t points = 0;  ///< read
  KernelChoice kernel;
  std::string surface;  ///< name of the surface kind
  std::string method;
  std::array<double, 3> size_mm{};       ///< of the placed scan
  PlacementOptions placement;            ///< as it was placed
  std::optional<ChosenStanding> chosen;  ///< where its turn was chosen here
  PickReport pick;                       ///< what was left out before the size was taken; frame and unit of the file
  std::string normals_json;              ///< report of the normals, as they came
  std::uint32_t layers_cut = 0;
  std::uint32_t certified = 0;  ///< measured or completed
  std::uint32_t completed = 0;  ///< of the certified: with stretches the scan does not show
  std::uint32_t certified_by_march = 0;
  std::vector<FlaggedLayer> flagged;
  SurfaceShares shares;        ///< what the contours of all layers rest on
  std::vector<LayerGap> gaps;  ///< of all layers, from below
  Openness open;
  CompletionSummary completion;
  SpeckSummary specks;
  std::vector<std::string> warnings;  ///< about the scan as a whole, for people
  std::uint64_t contours = 0;
  std::uint64_t vertices = 0;
  std::vector<std::uint64_t> layer_evaluations;  ///< of the field by march and grid, a layer each, from below
  std::optional<int> surface_euler;              ///< of the whole surface, from its critical points
  std::size_t critical_points = 0;
  std::vector<std::string> inconsistencies;  ///< about the topology, for people
  std::vector<StageTime> times;
};
/// Evaluations of a layer in the middle of all, and of the dearest.
struct LayerCosts {
  std::uint64_t all = 0, median = 0, most = 0;
};
[[nodiscard]] LayerCosts layer_costs(const SliceReport& report);

/// One JSON object, fixed key order; scan_to_build is a 4x4 list of rows, build = T * scan.
[[nodiscard]] std::string to_json(const SliceReport& report);

/// Called once a layer, in order, while slicing goes on, from the calling thread or a worker, never from two at once.
/// An error ends the slicing and becomes its result.
using LayerSink = std::function<Result<void>(const StackHeader&, Layer&&)>;

/// Scan file to layers: read, normals, placement (bottom at z = 0), surface, topology,
/// contours. Same request and bytes, same layers on any number of threads, and for any range of layers.
/// Fails: InvalidInput (the file, the request, a part larger than the machine: both sizes in the message; a size that
/// is hardly meant where neither the file nor the request states a unit or a size; no contour at all, or in less than
/// half of the height), TooLarge, Cancelled (within 0.2 s of the stop), or the sink's error.
[[nodiscard]] Result<SliceReport> slice_scan(std::span<const std::byte> scan, std::string_view name,
                                             const SliceRequest& request, const LayerSink& sink,
                                             const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::scan
