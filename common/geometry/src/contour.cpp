// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <telefab/geometry/contour.hpp>

namespace telefab {

double signed_area_mm2(std::span<const Point2> ring) {
  if (ring.size() < 3) return 0;
  // Relative to the first vertex: keeps digits when the ring is small and far from the origin.
  const Point2 o = ring[0];
  double twice = 0;
  for (std::size_t i = 1; i + 1 < ring.size(); ++i)
    twice +=
        (ring[i].x_mm - o.x_mm) * (ring[i + 1].y_mm - o.y_mm) - (ring[i + 1].x_mm - o.x_mm) * (ring[i].y_mm - o.y_mm);
  return twice / 2;
}

Result<Contour> Contour::from_vertices(std::vector<Point2> vertices) {
  if (vertices.size() < 3)
    return fail(ErrorCode::InvalidInput,
                fmt::format("a contour needs at least 3 vertices, this one has {}", vertices.size()));
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    if (!std::isfinite(vertices[i].x_mm) || !std::isfinite(vertices[i].y_mm))
      return fail(ErrorCode::InvalidInput, fmt::format("vertex {} of a contour is not finite", i));
    if (vertices[i] == vertices[(i + 1) % vertices.size()])
      return fail(ErrorCode::InvalidInput,
                  fmt::format("vertices {} and {} of a contour are equal", i, (i + 1) % vertices.size()));
  }
  const double area = telefab::signed_area_mm2(vertices);
  if (area == 0 || !std::isfinite(area)) return fail(ErrorCode::InvalidInput, "a contour encloses no area");
  return Contour{std::move(vertices), area};
}

Result<Contour> Contour::with_runs(std::span<const SurfaceRun> runs) const {
  std::vector<SurfaceRun> kept = merged(runs);
  if (auto ok = validate_runs(kept, vertices_.size()); !ok) return tl::unexpected{ok.error()};
  Contour same = *this;
  same.runs_ = std::move(kept);
  return same;
}

double Contour::length_mm() const {
  double length = 0;
  for (std::size_t i = 0; i < vertices_.size(); ++i) {
    length += distance_mm(vertices_[i], vertices_[(i + 1) % vertices_.size()]);
  }
  return length;
}

Bounds2 Contour::bounds() const {
  Bounds2 box{vertices_[0], vertices_[0]};
  for (const Point2 p : vertices_) box.include(p);
  return box;
}

bool contains(const Contour& ring, Point2 point) {
  bool inside = false;
  const auto v = ring.vertices();
  for (std::size_t i = 0, j = v.size() - 1; i < v.size(); j = i++) {
    if ((v[i].y_mm > point.y_mm) == (v[j].y_mm > point.y_mm)) continue;
    const double x = v[j].x_mm + (point.y_mm - v[j].y_mm) / (v[i].y_mm - v[j].y_mm) * (v[i].x_mm - v[j].x_mm);
    if (point.x_mm < x) inside = !inside;
  }
  return inside;
}

}  // namespace telefab
