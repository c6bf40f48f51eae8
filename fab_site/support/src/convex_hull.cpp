// SPDX-License-Identifier: GPL-3.0-or-later
#include "convex_hull.hpp"

#include <algorithm>

namespace telefab::fab {
namespace {

double cross(Point2 o, Point2 a, Point2 b) {
  return (a.x_mm - o.x_mm) * (b.y_mm - o.y_mm) - (a.y_mm - o.y_mm) * (b.x_mm - o.x_mm);
}

}  // namespace

std::vector<Point2> convex_hull(std::vector<Point2> points) {
  const auto before = [](Point2 a, Point2 b) { return a.x_mm != b.x_mm ? a.x_mm < b.x_mm : a.y_mm < b.y_mm; };
  std::sort(points.begin(), points.end(), before);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  if (points.size() < 3) return points;
  std::vector<Point2> hull;
  for (int side = 0; side < 2; ++side) {
    const std::size_t floor = hull.size();
    for (const Point2& p : points) {
      while (hull.size() >= floor + 2 && cross(hull[hull.size() - 2], hull.back(), p) <= 0) hull.pop_back();
      hull.push_back(p);
    }
    hull.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

}  // namespace telefab::fab
