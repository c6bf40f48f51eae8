// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace telefab::scan {

/// Cubes of one size over the cloud, each occupied by points, reached from outside, or enclosed. Outside is what a
/// flood from the border reaches through empty cubes; it leaks in through holes wider than a cube.
class OutsideGrid {
 public:
  /// `cell` in the unit of the points; made larger where the grid would have more than `max_cells`.
  /// What a fine grid reaches through a leak but a `coarser` one encloses does not count as outside; `coarser` may be
  /// null and must live on.
  OutsideGrid(std::span<const Eigen::Vector3f> points, float cell, std::size_t max_cells, const OutsideGrid* coarser);

  /// Which side of the surface at `point` is outside: +1 the side of `normal`, -1 the other one, 0 neither. Nothing
  /// where this grid cannot tell: it leaks, or another surface is too near.
  [[nodiscard]] std::optional<int> outward_side(const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const;

 private:
  enum class Cell : std::uint8_t { Enclosed, Occupied, Outside };
  [[nodiscard]] std::optional<bool> sees_outside(const Eigen::Vector3f& point, const Eigen::Vector3f& direction) const;
  [[nodiscard]] std::size_t index_of(const Eigen::Vector3f& point) const;
  /// Calls `use` with the index of each of the six cells that share a face with `cell`.
  template <class Use>
  void for_each_touching(std::size_t cell, Use use) const;
  void flood();
  [[nodiscard]] bool is_enclosed(const Eigen::Vector3f& point) const {
    return cells_[index_of(point)] == Cell::Enclosed;
  }

  Eigen::Vector3f low_;
  float cell_;
  const OutsideGrid* coarser_;
  Eigen::Array3i size_;
  std::vector<Cell> cells_;
};

}  // namespace telefab::scan
