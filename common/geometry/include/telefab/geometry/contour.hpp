// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <telefab/base/result.hpp>
#include <telefab/geometry/surface_run.hpp>
#include <vector>

namespace telefab {

/// A point of a layer, build frame: x to the right, y to the back, origin at the platform's front left corner.
struct Point2 {
  double x_mm = 0;
  double y_mm = 0;
  friend bool operator==(const Point2&, const Point2&) = default;
};

[[nodiscard]] inline double distance_mm(Point2 a, Point2 b) { return std::hypot(b.x_mm - a.x_mm, b.y_mm - a.y_mm); }

/// An axis-parallel box of a layer, build frame. Without min above max it holds at least one point.
struct Bounds2 {
  Point2 min;
  Point2 max;

  /// Holds no point; grows by include().
  [[nodiscard]] static constexpr Bounds2 nothing() {
    constexpr double far = std::numeric_limits<double>::infinity();
    return {{far, far}, {-far, -far}};
  }
  [[nodiscard]] bool is_nothing() const { return min.x_mm > max.x_mm; }
  /// Negative infinity where it holds no point.
  [[nodiscard]] double width_mm() const { return max.x_mm - min.x_mm; }
  [[nodiscard]] double depth_mm() const { return max.y_mm - min.y_mm; }
  void include(Point2 p) {
    min = {std::min(min.x_mm, p.x_mm), std::min(min.y_mm, p.y_mm)};
    max = {std::max(max.x_mm, p.x_mm), std::max(max.y_mm, p.y_mm)};
  }
  /// What the other holds; a box that holds nothing changes nothing.
  void include(const Bounds2& other) {
    min = {std::min(min.x_mm, other.min.x_mm), std::min(min.y_mm, other.min.y_mm)};
    max = {std::max(max.x_mm, other.max.x_mm), std::max(max.y_mm, other.max.y_mm)};
  }
  friend bool operator==(const Bounds2&, const Bounds2&) = default;
};

/// One closed ring in a layer. The last vertex joins the first and is not repeated. Outer rings run
/// counter-clockwise (positive area), holes clockwise (negative area), seen from above.
/// Invariant: at least three vertices, all finite, no two neighbours equal, signed area not zero.
/// That rings do not cross is the layer's promise (LayerCertificate), not checked here.
/// A ring may say of each of its edges what it rests on (SurfaceRun).
class Contour {
 public:
  /// Fails with InvalidInput if the invariant does not hold. Never repairs.
  [[nodiscard]] static Result<Contour> from_vertices(std::vector<Point2> vertices);
  /// The same ring with what its edges rest on, edge 0 first; neighbours of one class are merged. Fails with
  /// InvalidInput where the runs do not account for every edge or a length is impossible.
  [[nodiscard]] Result<Contour> with_runs(std::span<const SurfaceRun> runs) const;

  [[nodiscard]] std::span<const Point2> vertices() const { return vertices_; }
  /// What the edges rest on, merged; empty where all are measured, or where nobody looked (see the certificate).
  [[nodiscard]] std::span<const SurfaceRun> runs() const { return runs_; }
  [[nodiscard]] double signed_area_mm2() const { return signed_area_mm2_; }
  [[nodiscard]] bool is_hole() const { return signed_area_mm2_ < 0; }
  [[nodiscard]] double length_mm() const;
  [[nodiscard]] Bounds2 bounds() const;
  friend bool operator==(const Contour& a, const Contour& b) {
    return a.vertices_ == b.vertices_ && a.runs_ == b.runs_;
  }

 private:
  Contour(std::vector<Point2> vertices, double area) : vertices_{std::move(vertices)}, signed_area_mm2_{area} {}
  std::vector<Point2> vertices_;
  std::vector<SurfaceRun> runs_;
  double signed_area_mm2_ = 0;
};

/// The shoelace sum; exact sign is not promised for very thin rings. Any number of vertices.
[[nodiscard]] double signed_area_mm2(std::span<const Point2> ring);

/// Even-odd test against the ring; points on the boundary may fall to either side.
[[nodiscard]] bool contains(const Contour& ring, Point2 point);

}  // namespace telefab
