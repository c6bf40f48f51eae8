// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <limits>

namespace telefab::scan {

using Vec3 = Eigen::Vector3d;

/// An axis-parallel box, frame and unit of whatever it was made of. Without min above max it holds at least one point.
struct Box3 {
  Vec3 min = Vec3::Zero();
  Vec3 max = Vec3::Zero();

  /// Holds no point; grows by include().
  [[nodiscard]] static Box3 nothing() {
    const Vec3 far = Vec3::Constant(std::numeric_limits<double>::infinity());
    return {far, -far};
  }
  [[nodiscard]] Vec3 size() const { return max - min; }
  [[nodiscard]] Vec3 middle() const { return (min + max) / 2; }
  /// The rim belongs to it.
  [[nodiscard]] bool contains(const Vec3& p) const {
    return (p.array() >= min.array()).all() && (p.array() <= max.array()).all();
  }
  void include(const Vec3& p) {
    min = min.cwiseMin(p);
    max = max.cwiseMax(p);
  }
  /// What the other holds; a box that holds nothing changes nothing.
  void include(const Box3& other) {
    min = min.cwiseMin(other.min);
    max = max.cwiseMax(other.max);
  }
};

}  // namespace telefab::scan
