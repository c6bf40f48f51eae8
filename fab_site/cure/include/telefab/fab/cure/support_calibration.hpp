// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/fab/cure/calibration.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/image/png.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// One thing of the print that either holds or tears.
struct SupportSpecimen {
  enum class Kind : std::uint8_t {
    Ladder = 1,     ///< a disc on three equal necks, pulled through their middle
    OffCentre = 2,  ///< the same, the necks moved to one side
    Shelf = 3,      ///< a wall that jumps outwards in one layer
  };
  Kind kind = Kind::Ladder;
  int number = 0;           ///< 1 and up, as on the map and in the table
  Bounds2 box;              ///< seen from above
  double demand = 0;        ///< stress in the necks over pull, from lit pixels; the worst neck's; shelves: 0
  double overhang_mm = 0;   ///< shelves: how far the layer jumps
  double neck_mm2 = 0;      ///< lit area of one neck; shelves: 0
  double offset_share = 0;  ///< off centre: how far the necks are moved, of the disc's radius
};
/// "ladder", "off-centre", "shelf": as in the table.
[[nodiscard]] std::string_view name_of(SupportSpecimen::Kind kind);

/// What stands where, by number. Discs are 200 pixels across where the platform is large enough for all of them, at
/// least 64; demands rise by a quarter from 30 up to 850 or to necks 4 pixels wide, each step twice. Necks stand at
/// half the radius. Fails with InvalidInput where not all fit on the platform and under its travel.
[[nodiscard]] Result<std::vector<SupportSpecimen>> support_specimens(const MachineProfile& machine);

/// A print that asks for more and more, so that a part of it tears.
struct SupportPrint {
  LayerStack stack;  ///< to be planned without supports, masks by cover; outlines run along pixels
  std::vector<SupportSpecimen> specimens;
  std::string supports_csv;  ///< header and one row a specimen, what held left empty
  std::string readme;        ///< how to print and what to look at
  Image map;                 ///< seen from above, the front below, with numbers
  double disc_mm = 0;        ///< diameter of the discs
  double block_mm2 = 0;      ///< the largest layer: the block that all stand on
};
/// Fails as support_specimens().
[[nodiscard]] Result<SupportPrint> support_print(const MachineProfile& machine);

/// Whether a specimen held.
struct SupportReading {
  SupportSpecimen specimen;
  bool held = false;
};

/// Reads the filled-in table: columns machine, test, number, demand, overhang_mm, held (yes or no). Fails with
/// InvalidInput by line: another machine, a number that the print of this machine does not have or that was there
/// before, a demand or overhang that its profile does not give, what is neither yes nor no; else as
/// measured_from_csv().
[[nodiscard]] Result<std::vector<SupportReading>> support_readings_from_csv(std::string_view text,
                                                                            const MachineProfile& machine);

/// Which ends of an interval the readings bound.
enum class KnownEnds : std::uint8_t { Both = 1, Least = 2, Most = 3 };

/// What tears, from what held: a threshold of the demand with log-normal scatter.
struct SupportCalibration {
  FittedFigure
      demand;  ///< r: strength of a fresh tip over pull, without safety; 95 % by likelihood ratio with Student's t
  KnownEnds demand_ends = KnownEnds::Both;
  double scatter = 0;  ///< sigma of ln r from specimen to specimen; no less than 0.03
  /// kappa of a layer's overhang, 3 (l / t)^2 / r of the longest shelf that is whole below those that tore. None where
  /// none is whole or none was read.
  std::optional<FittedFigure> overhang_share;
  KnownEnds overhang_ends = KnownEnds::Both;
  std::optional<double> overhang_share_below;  ///< where no shelf is whole
  std::size_t discs = 0, shelves = 0;          ///< how many were read
  std::vector<SupportReading> off_centre;      ///< as read
};

/// Fits r by maximum likelihood to the ladder, kappa to ladder and shelves. All discs held: r is at least the largest
/// demand. Fails with InvalidInput: fewer than four discs of the ladder, none held, discs of higher demand held where
/// those of lower tore, shelves likewise.
[[nodiscard]] Result<SupportCalibration> fit_supports(std::span<const SupportReading> readings, double thickness_mm);

/// Sections of the profile that make carried_demand() r over the profile's safety: pull as stated or assumed, strength
/// to match; the reach of one layer. Intervals and what no key holds as comments.
[[nodiscard]] std::string to_toml_fragment(const SupportCalibration& calibration, const MachineProfile& machine);
/// The profile with what was fitted put in its place, no longer assumed.
[[nodiscard]] MachineProfile with_supports(MachineProfile machine, const SupportCalibration& calibration);

}  // namespace telefab::fab
