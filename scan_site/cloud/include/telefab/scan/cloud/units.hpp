#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::scan {

/// Millimetres in one "mm", "cm", "m" or "in". Fails: InvalidInput for any other word.
[[nodiscard]] Result<double> millimetres_per(std::string_view unit);

/// Positions (and origin) times `factor`; normals and confidence stay, and a stated unit stays right.
[[nodiscard]] PointCloud scaled(PointCloud cloud, double factor);

/// A sentence if the size of the cloud, taken as millimetres, is hardly that of a thing to be printed (below 2 mm or
/// above 3 m): most likely the file is in another unit.
[[nodiscard]] std::optional<std::string> doubt_about_scale(const PointCloud& cloud_mm);

}  // namespace telefab::scan
