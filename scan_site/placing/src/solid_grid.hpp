// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <stop_token>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// Distance to the surface of a cloud (negative inside) at the corners of a grid around it, cut off at kBand pitches.
/// Unit and frame of the cloud's points, relative to its origin.
class SolidGrid {
 public:
  static constexpr float kBand = 3;
  /// Distance and its gradient, which points outward.
  struct Answer {
    float distance = 0;
    Eigen::Vector3f gradient = Eigen::Vector3f::Zero();
  };

  /// About so many corners. One normal and one area a point. Once it is stopped the rest stays outside.
  SolidGrid(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals,
            const std::vector<float>& areas, double corners, const std::stop_token& stop);
  /// Every `step`-th corner.
  [[nodiscard]] SolidGrid thinned(int step) const;

  [[nodiscard]] float pitch() const { return pitch_; }
  [[nodiscard]] const Eigen::Vector3f& low() const { return low_; }
  [[nodiscard]] Eigen::Vector3f high() const {
    return low_ + pitch_ * Eigen::Vector3f{static_cast<float>(count_[0] - 1), static_cast<float>(count_[1] - 1),
                                           static_cast<float>(count_[2] - 1)};
  }
  /// Straight between the corners; kBand pitches outside of the grid.
  [[nodiscard]] float distance(const Eigen::Vector3f& place) const;
  [[nodiscard]] Answer at(const Eigen::Vector3f& place) const;

 private:
  SolidGrid() = default;
  struct Cell {
    std::size_t corner = 0;
    Eigen::Vector3f within = Eigen::Vector3f::Zero();
    bool is_inside = false;
  };
  [[nodiscard]] Cell cell_of(const Eigen::Vector3f& place) const;

  Eigen::Vector3f low_ = Eigen::Vector3f::Zero();
  float pitch_ = 1;
  std::array<int, 3> count_{};
  std::vector<float> distance_;  ///< x fastest
};

}  // namespace telefab::scan
