// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/placing/turn.hpp>
#include <vector>

namespace telefab::scan {

/// What a scan shall be made to stand for: least support, least height (that is time), or least surface that supports
/// and steps of layers mark.
enum class StandFor : std::uint8_t { Supports = 1, Height = 2, Quality = 3 };
/// "supports", "height", "quality"; InvalidInput lists them.
[[nodiscard]] Result<StandFor> stand_for_from(std::string_view name);
[[nodiscard]] std::string_view name_of(StandFor goal);

/// What decides how directions compare. Supports depend on the size of a part, so its size enters.
struct StandingOptions {
  MachineProfile machine;
  double layer_mm = 0;                 ///< (0, 1]
  std::optional<double> height_mm;     ///< > 0; the part is made so high, whichever way it stands
  double scale = 1;                    ///< > 0; where there is no height and no fit: millimetres a unit
  bool fit = false;                    ///< as large as the machine holds that way
  Vec3 axis_scale = Vec3::Ones();      ///< along the axes of the platform, after all else
  std::optional<double> thickness_mm;  ///< > 0; the scan is a sheet, so thick behind its samples
  StandFor goal = StandFor::Supports;
  std::uint32_t directions = 300;  ///< [1, 5000]; spread evenly; axes and flat sides come on top
  std::uint32_t in_full = 60;      ///< [1, 5000]; so many of the best are judged on the fine grid
  double corners = 800'000;        ///< [1e4, 1e8]; of the fine grid
  [[nodiscard]] Result<void> validate() const;
};

/// Millimetres of the print in a unit of the scan. `size`: of the turned scan in its own unit, drawn out along the axes
/// of the platform (`axis_scale`); above 0.
[[nodiscard]] double scale_for(const Vec3& size, const StandingOptions& options);

/// Where a direction came from.
enum class StandingSource : std::uint8_t { AsInFile = 1, Axis = 2, FlatSide = 3, OpenSide = 4, Spread = 5 };
/// "as in the file", "axis", "flat side", "open side", "spread".
[[nodiscard]] std::string_view name_of(StandingSource source);

/// What a way to stand costs, estimated on a grid of the part: the fab's planner gives the true figures.
struct StandingFigures {
  Vec3 size_mm = Vec3::Zero();  ///< with axis_scale
  double part_mm3 = 0;
  double support_mm3 = 0;  ///< pins, arms, feet, plates
  std::uint32_t anchors = 0;
  double overhang_mm2 = 0;  ///< what anchors have to hold, seen from below
  double stepped_mm2 = 0;   ///< surface so flat, and not level, that its layers show as steps
  double surface_mm2 = 0;
  bool is_lifted = false;    ///< it has no side to stand on
  std::uint32_t layers = 0;  ///< with those it is lifted by
  double trapped_mm3 = 0;    ///< the most liquid that a growing part keeps in cups and hollows
  double stability = 0;      ///< how far inside its footing its middle is, over the height of that; below 0: outside
  friend bool operator==(const StandingFigures&, const StandingFigures&) = default;
};

struct Standing {
  Turn turn;  ///< of the scan; from angles rounded to 1e-4 degrees, so that its text gives the same turn
  StandingSource source = StandingSource::Spread;
  StandingFigures figures;
  double cost = 0;  ///< by the goal; the least is best
};

/// Called with the share that is done, from one thread at a time.
using ShareSink = std::function<void(double)>;

/// Judges directions all over the sphere by what they would cost: a grid of the part is filled from the winding number
/// and the distance to its samples, turned, and built up layer by layer as the planner of the fab does - what no layer
/// below carries, anchors under it, pins to the platform or, where none is free, to the part. The best come first, with
/// the way the scan lies in its file among them, as far as it fits. Each is turned about the vertical so that
/// the smallest rectangle around it lies along the platform. Needs outward normals; the cloud is in any unit.
/// Same cloud and options, same result on any number of threads. Fails: InvalidInput (options, no normals, larger than
/// the machine every way), Cancelled.
[[nodiscard]] Result<std::vector<Standing>> judged_standings(const PointCloud& cloud, const StandingOptions& options,
                                                             const ShareSink& progress, std::stop_token stop);

/// What it costs to stand in this turn alone, as judged_standings would say; `source` is AsInFile. `goal`, `directions`
/// and `in_full` do not matter. Cost: that of the grid, under a second a core at 200,000 corners. Fails as
/// judged_standings does.
[[nodiscard]] Result<Standing> judged_standing(const PointCloud& cloud, const StandingOptions& options,
                                               const Turn& turn, std::stop_token stop);

/// Sets the costs and sorts, the best first; equal ones stay in their order.
void rank(std::vector<Standing>& standings, StandFor goal);

/// The best few whose directions differ by so many degrees, in their order.
[[nodiscard]] std::vector<Standing> best_apart(const std::vector<Standing>& judged, std::size_t most, double apart_deg);

}  // namespace telefab::scan
