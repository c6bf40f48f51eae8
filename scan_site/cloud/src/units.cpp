// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/units.hpp>

#include <fmt/format.h>
#include <array>

namespace telefab::scan {
namespace {

/// Likeliest first.
constexpr std::array<std::string_view, 4> kUnits{"mm", "m", "in", "cm"};

}  // namespace

Result<double> millimetres_per(std::string_view unit) {
  if (unit == "mm") return 1.0;
  if (unit == "cm") return 10.0;
  if (unit == "m") return 1000.0;
  if (unit == "in") return 25.4;
  return fail(ErrorCode::InvalidInput, fmt::format("unit '{}' is not known; mm, cm, m and in are", unit.substr(0, 20)));
}

PointCloud scaled(PointCloud cloud, double factor) {
  cloud.origin *= factor;
  cloud.rounding *= factor;
  if (cloud.unit_mm) *cloud.unit_mm /= factor;
  for (Eigen::Vector3f& p : cloud.points) p = (p.cast<double>() * factor).cast<float>();
  for (float& apart : cloud.sheets_apart) apart *= static_cast<float>(factor);
  return cloud;
}

std::optional<std::string> scale_warning(const Vec3& size_mm, double unit_mm) {
  const double size = size_mm.maxCoeff();
  const auto plausible = [](double mm) { return mm >= 2 && mm <= 3000; };
  if (plausible(size)) return std::nullopt;
  std::string warning = fmt::format("the scan would be {:.3g} mm at its longest, which is hardly meant", size);
  for (const std::string_view unit : kUnits)
    if (const double other = size / unit_mm * *millimetres_per(unit); plausible(other))
      return warning + fmt::format("; if its unit is {}, it is {:.3g} mm: say --units {}", unit, other, unit);
  return warning + "; no unit of mm, cm, m and in makes it 2 mm to 3 m: state its size (--height-mm or --scale)";
}

std::optional<std::string> scale_warning(const PointCloud& cloud_mm, double unit_mm) {
  return cloud_mm.points.empty() ? std::nullopt : scale_warning(size_of(cloud_mm), unit_mm);
}

Vec3 size_of(const PointCloud& cloud) {
  if (cloud.points.empty()) return Vec3::Zero();
  Eigen::Vector3f low = cloud.points[0], high = cloud.points[0];
  for (const auto& p : cloud.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return high.cast<double>() - low.cast<double>();
}

}  // namespace telefab::scan
