// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <stop_token>
#include <telefab/scan/cloud/clean.hpp>
#include <telefab/scan/registration/doubled_sheets.hpp>
#include <telefab/scan/registration/register_views.hpp>

namespace telefab::scan {

struct MergeOptions {
  double thinning = 0.75;   ///< (0, 4]; spacings between the points kept where views overlap
  double reach = 3;         ///< > 0; spacings within which other views' points are the same surface
  Vec3 up = Vec3::UnitY();  ///< along which `cut_below` is measured, frame of the result
  std::optional<double>
      cut_below;  ///< removes what lies lower than this above the lowest point: the stand; unit of the files
  /// Where the views show two sheets: the points of the cloud say so (PointCloud::sheets_apart). Not owned; none:
  /// nobody looked.
  const DoubledSheets* sheets = nullptr;
  [[nodiscard]] Result<void> validate() const;
};

struct MergeReport {
  std::size_t points_in = 0;       ///< of all views
  std::size_t edge_points = 0;     ///< left out: depth edges, rims, grazing views
  std::size_t stand_points = 0;    ///< left out: below the cut
  std::size_t thinned_points = 0;  ///< left out: the same place was seen better
  double moved_rms = 0;            ///< how far averaging over the views moved the points, unit of the files
  CleanReport cleaning;
};

struct Merged {
  PointCloud cloud;  ///< oriented, with confidence: the weight of all views that saw the place, 1 = the best
  MergeReport report;
};

/// One oriented cloud of all views: every point moves along its normal to the mean of what the views see there,
/// weighted by the cosine of incidence (grazing views count less), then the best point of each place stays, then
/// outliers and small clusters go (CleanOptions::careful). Fails: InvalidInput, Cancelled.
[[nodiscard]] Result<Merged> merge_views(std::span<const RangeImage> views, std::span<const RigidMotion> poses,
                                         const MergeOptions& options, std::stop_token stop);

[[nodiscard]] std::string to_json(const MergeReport& report);

}  // namespace telefab::scan
