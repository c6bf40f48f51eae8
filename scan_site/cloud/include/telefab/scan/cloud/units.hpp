// SPDX-License-Identifier: GPL-3.0-or-later
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

/// A sentence if a thing of this size is hardly one to be printed (longest side below 2 mm or above 3 m): most likely
/// its file is in another unit, and the sentence names one that would make it fit. `unit_mm`: millimetres in one unit
/// of the file, as it was understood.
[[nodiscard]] std::optional<std::string> scale_warning(const Vec3& size_mm, double unit_mm);
/// The same of a cloud in millimetres.
[[nodiscard]] std::optional<std::string> scale_warning(const PointCloud& cloud_mm, double unit_mm);

/// Extent along x, y and z; zero for no points.
[[nodiscard]] Vec3 size_of(const PointCloud& cloud);

}  // namespace telefab::scan
