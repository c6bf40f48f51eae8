// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/registration/range_image.hpp>
#include <vector>

namespace telefab::scan {

/// What a cloud without a grid is among views.
enum class GridlessCloud : std::uint8_t {
  Refused = 1,  ///< steps of a turn and poses are of range images
  View = 2,     ///< a view that sees through nothing; its normals are made where it has none
};

/// The views that one file holds, called `name`, or "name#0", "name#1", ... where there are several. Fails as
/// make_range_image, make_gridless_image and orient_cloud do.
[[nodiscard]] Result<std::vector<RangeImage>> views_of(ScanFile file, const std::string& name, GridlessCloud cloud,
                                                       const std::stop_token& stop);

/// So far apart views may be on the whole before they are refused, in their unit: by the coarsest of them.
[[nodiscard]] double most_rms_of(std::span<const RangeImage> views);

}  // namespace telefab::scan
