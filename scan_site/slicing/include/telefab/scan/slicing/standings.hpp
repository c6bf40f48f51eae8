// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/scan/placing/standing.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// The other hand of a cloud, as placement makes it.
[[nodiscard]] PointCloud mirrored(PointCloud cloud, MirrorAxis axis);

/// What is sought.
struct StandingSearch {
  StandFor goal = StandFor::Supports;
  std::uint32_t directions = 300;  ///< as in StandingOptions
};

/// The ways in which a prepared scan could stand for this request, the best for the goal first (judged_standings): with
/// its machine, layers, size and mirror. `turn` and `position_mm` do not matter. Fails as judged_standings does.
[[nodiscard]] Result<std::vector<Standing>> standings_of(const PointCloud& prepared, const SliceRequest& request,
                                                         const StandingSearch& search, const ShareSink& progress,
                                                         std::stop_token stop);

/// What the request's own turn would cost: about a second where standings_of takes many. Fails as judged_standing does.
[[nodiscard]] Result<Standing> standing_of(const PointCloud& prepared, const SliceRequest& request,
                                           std::stop_token stop);

/// The best of them.
[[nodiscard]] Result<ChosenStanding> chosen_standing(const PointCloud& prepared, const SliceRequest& request,
                                                     StandFor goal, std::stop_token stop);

/// Millimetres of the print in a unit of a prepared scan, mirrored and turned as the request says. What is no size at
/// all gives 1.
[[nodiscard]] double print_scale(const PointCloud& prepared, const SliceRequest& request);

/// One JSON object, fixed key order.
[[nodiscard]] std::string to_json(const StandingFigures& figures);

}  // namespace telefab::scan
