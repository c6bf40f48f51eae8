// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/scan/slicing/orient_cloud.hpp>
#include <telefab/scan/staging/view_file.hpp>

namespace telefab::scan {
namespace {

/// Of spacings of a view's grid.
constexpr double kMostRmsSpacings = 0.6;

}  // namespace

Result<std::vector<RangeImage>> views_of(ScanFile file, const std::string& name, GridlessCloud cloud,
                                         const std::stop_token& stop) {
  std::vector<RangeImage> views;
  if (file.views.empty() && cloud == GridlessCloud::View) {
    auto oriented = orient_cloud(std::move(file.cloud), stop);
    if (!oriented) return fail_in(name, oriented.error());
    auto image = make_gridless_image(oriented->cloud, name);
    if (!image) return tl::unexpected{image.error()};
    views.push_back(std::move(*image));
    return views;
  }
  // A file without a view is refused as one whose first is missing.
  for (std::size_t v = 0; v < std::max<std::size_t>(1, file.views.size()); ++v) {
    auto image = make_range_image(file, v, file.views.size() > 1 ? fmt::format("{}#{}", name, v) : name);
    if (!image) return tl::unexpected{image.error()};
    views.push_back(std::move(*image));
  }
  return views;
}

double most_rms_of(std::span<const RangeImage> views) {
  float spacing = 0;
  for (const RangeImage& view : views) spacing = std::max(spacing, view.spacing);
  return kMostRmsSpacings * static_cast<double>(spacing);
}

}  // namespace telefab::scan
