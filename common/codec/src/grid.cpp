// SPDX-License-Identifier: GPL-3.0-or-later
#include "grid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace telefab::codec {

Result<Grid> Grid::over(const StackHeader& header, std::uint32_t grid_per_pitch) {
  Grid grid;
  grid.origin_ = header.bounds.min;
  grid.step_mm_ = header.pixel_pitch_mm / grid_per_pitch;
  const double x = std::floor((header.bounds.max.x_mm - header.bounds.min.x_mm) / grid.step_mm_);
  const double y = std::floor((header.bounds.max.y_mm - header.bounds.min.y_mm) / grid.step_mm_);
  constexpr double most = 1 << 29;
  if (!(x >= 0 && x <= most && y >= 0 && y <= most))
    return fail(ErrorCode::InvalidInput,
                fmt::format("the bounds hold {} x {} grid steps, at most {} are possible", x, y, most));
  grid.most_ = {static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
  // Rounding must not carry the last lattice point past the bounds.
  while (grid.most_.x > 0 && grid.point(grid.most_).x_mm > header.bounds.max.x_mm) --grid.most_.x;
  while (grid.most_.y > 0 && grid.point(grid.most_).y_mm > header.bounds.max.y_mm) --grid.most_.y;
  return grid;
}

GridPoint Grid::snap(Point2 point) const {
  const auto index = [&](double offset_mm, std::int32_t most) {
    return static_cast<std::int32_t>(
        std::clamp(std::floor(offset_mm / step_mm_ + 0.5), 0.0, static_cast<double>(most)));
  };
  return {index(point.x_mm - origin_.x_mm, most_.x), index(point.y_mm - origin_.y_mm, most_.y)};
}

std::vector<GridPoint> Grid::snap(const Contour& ring) const {
  std::vector<GridPoint> points;
  points.reserve(ring.vertices().size());
  for (const Point2 vertex : ring.vertices()) {
    const GridPoint p = snap(vertex);
    if (points.empty() || !(points.back() == p)) points.push_back(p);
  }
  while (points.size() > 1 && points.back() == points.front()) points.pop_back();
  const auto made = contour(points);
  if (!made || made->is_hole() != ring.is_hole()) return {};
  return points;
}

Result<Contour> Grid::contour(const std::vector<GridPoint>& ring) const {
  std::vector<Point2> vertices;
  vertices.reserve(ring.size());
  for (const GridPoint p : ring) vertices.push_back(point(p));
  return Contour::from_vertices(std::move(vertices));
}

}  // namespace telefab::codec
