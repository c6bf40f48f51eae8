// SPDX-License-Identifier: GPL-3.0-or-later
#include "outside_grid.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::scan {

OutsideGrid::OutsideGrid(std::span<const Eigen::Vector3f> points, float cell, std::size_t max_cells,
                         const OutsideGrid* coarser)
    : cell_{cell}, coarser_{coarser} {
  Eigen::Vector3f low = points[0], high = points[0];
  for (const Eigen::Vector3f& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const auto cells_of = [&](float edge) {
    const Eigen::Array3d n = ((high - low).cast<double>().array() / edge).floor() + 7;
    return n.prod();
  };
  while (cells_of(cell_) > static_cast<double>(max_cells)) cell_ *= 1.1F;
  size_ = ((high - low).array() / cell_).floor().cast<int>() + 7;
  low_ = low.array() - 3 * cell_;  // an empty rim, so that the flood goes round and no look-up leaves the grid
  cells_.assign(static_cast<std::size_t>(size_.cast<double>().prod()), Cell::Enclosed);
  for (const Eigen::Vector3f& p : points) cells_[index_of(p)] = Cell::Occupied;
  flood();
}

std::size_t OutsideGrid::index_of(const Eigen::Vector3f& point) const {
  const Eigen::Array3i at = ((point - low_).array() / cell_).floor().cast<int>().max(0).min(size_ - 1);
  return static_cast<std::size_t>(at.x()) +
         static_cast<std::size_t>(size_.x()) * (static_cast<std::size_t>(at.y()) +
                                                static_cast<std::size_t>(size_.y()) * static_cast<std::size_t>(at.z()));
}

template <class Use>
void OutsideGrid::for_each_touching(std::size_t cell, Use use) const {
  const std::size_t nx = static_cast<std::size_t>(size_.x()), ny = static_cast<std::size_t>(size_.y()),
                    nz = static_cast<std::size_t>(size_.z());
  const std::size_t x = cell % nx, y = cell / nx % ny, z = cell / (nx * ny);
  if (x > 0) use(cell - 1);
  if (x + 1 < nx) use(cell + 1);
  if (y > 0) use(cell - nx);
  if (y + 1 < ny) use(cell + nx);
  if (z > 0) use(cell - nx * ny);
  if (z + 1 < nz) use(cell + nx * ny);
}

void OutsideGrid::flood() {
  std::vector<std::size_t> front{0};
  cells_[0] = Cell::Outside;
  while (!front.empty()) {
    const std::size_t at = front.back();
    front.pop_back();
    for_each_touching(at, [&](std::size_t next) {
      if (cells_[next] != Cell::Enclosed) return;
      cells_[next] = Cell::Outside;
      front.push_back(next);
    });
  }
}

std::optional<bool> OutsideGrid::sees_outside(const Eigen::Vector3f& point, const Eigen::Vector3f& direction) const {
  for (float t = 0.5F; t <= 2.26F; t += 0.25F) {
    const Eigen::Vector3f at = point + direction * (t * cell_);
    const Cell cell = cells_[index_of(at)];
    if (cell == Cell::Enclosed) return false;
    if (cell == Cell::Outside) return coarser_ && coarser_->is_enclosed(at) ? std::nullopt : std::optional{true};
  }
  return std::nullopt;
}

std::optional<int> OutsideGrid::outward_side(const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const {
  const auto ahead = sees_outside(point, normal);
  const auto behind = sees_outside(point, -normal);
  if (ahead == true && behind == false) return 1;
  if (ahead == false && behind == true) return -1;
  if (ahead == false && behind == false) return 0;
  return std::nullopt;
}

}  // namespace telefab::scan
