// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <functional>
#include <numbers>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// Oriented samples with the area each stands for.
struct Sampled {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> areas;

  void add(const Sampled& other) {
    points.insert(points.end(), other.points.begin(), other.points.end());
    normals.insert(normals.end(), other.normals.begin(), other.normals.end());
    areas.insert(areas.end(), other.areas.begin(), other.areas.end());
  }
  [[nodiscard]] PointCloud cloud() const {
    PointCloud cloud;
    cloud.points = points;
    cloud.normals = normals;
    return cloud;
  }
};

/// Even samples of a ball (spiral of Fibonacci), those only that `seen` (by direction) keeps.
inline Sampled sampled_ball(const Eigen::Vector3f& centre, float radius, int count,
                            const std::function<bool(const Eigen::Vector3f&)>& seen = {}) {
  Sampled s;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  const double area = 4 * std::numbers::pi * radius * radius / count;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count;
    const double r = std::sqrt(1 - z * z);
    const Eigen::Vector3f n = Eigen::Vector3d{r * std::cos(golden * i), r * std::sin(golden * i), z}.cast<float>();
    if (seen && !seen(n)) continue;
    s.points.push_back(centre + radius * n);
    s.normals.push_back(n);
    s.areas.push_back(static_cast<float>(area));
  }
  return s;
}

}  // namespace telefab::scan
