#include <telefab/scan/cloud/units.hpp>

#include <fmt/format.h>
#include <algorithm>

namespace telefab::scan {

Result<double> millimetres_per(std::string_view unit) {
  if (unit == "mm") return 1.0;
  if (unit == "cm") return 10.0;
  if (unit == "m") return 1000.0;
  if (unit == "in") return 25.4;
  return fail(ErrorCode::InvalidInput, fmt::format("unit '{}' is not known; mm, cm, m and in are", unit.substr(0, 20)));
}

PointCloud scaled(PointCloud cloud, double factor) {
  cloud.origin *= factor;
  if (cloud.unit_mm) *cloud.unit_mm /= factor;
  for (Eigen::Vector3f& p : cloud.points) p = (p.cast<double>() * factor).cast<float>();
  return cloud;
}

std::optional<std::string> doubt_about_scale(const PointCloud& cloud_mm) {
  if (cloud_mm.points.empty()) return std::nullopt;
  Eigen::Vector3f low = cloud_mm.points[0], high = cloud_mm.points[0];
  for (const auto& p : cloud_mm.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const float size = (high - low).maxCoeff();
  if (size >= 2 && size <= 3000) return std::nullopt;
  return fmt::format("the scan would be {:.4g} mm across; is its unit {}? State it with --units", size,
                     size < 2 ? "metres (or inches)" : "micrometres");
}

}  // namespace telefab::scan
