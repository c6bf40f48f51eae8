// SPDX-License-Identifier: GPL-3.0-or-later
#include "doubtful_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

namespace telefab::scan {
namespace {

/// Contours of two finders part where they run farther from each other than these, tried in turn, in kernel widths.
constexpr std::array kReachKernels{0.5, 0.1, 0.01};

double distance_to_edge(Point2 p, Point2 a, Point2 b) {
  const double x = b.x_mm - a.x_mm, y = b.y_mm - a.y_mm, length2 = x * x + y * y;
  const double t = length2 > 0 ? std::clamp(((p.x_mm - a.x_mm) * x + (p.y_mm - a.y_mm) * y) / length2, 0.0, 1.0) : 0;
  return std::hypot(a.x_mm + t * x - p.x_mm, a.y_mm + t * y - p.y_mm);
}

/// Contours as points less than half of `reach_mm` apart, by cells: whether one runs near a place.
class Nearby {
 public:
  Nearby(std::span<const Contour> contours, double reach_mm) : reach_mm_{reach_mm} {
    for (const Contour& ring : contours) {
      const auto v = ring.vertices();
      for (std::size_t i = 0; i < v.size(); ++i) {
        const Point2 a = v[i], b = v[i + 1 == v.size() ? 0 : i + 1];
        const double steps = std::ceil(2 * distance_mm(a, b) / reach_mm) + 1;
        for (double k = 0; k < steps; ++k) {
          const double t = k / steps;
          const Point2 p{a.x_mm + t * (b.x_mm - a.x_mm), a.y_mm + t * (b.y_mm - a.y_mm)};
          cells_[key(cell(p.x_mm), cell(p.y_mm))].push_back(p);
        }
      }
    }
  }
  [[nodiscard]] bool runs_near(Point2 p) const {
    for (std::int64_t i = -1; i <= 1; ++i)
      for (std::int64_t j = -1; j <= 1; ++j)
        if (const auto found = cells_.find(key(cell(p.x_mm) + i, cell(p.y_mm) + j)); found != cells_.end())
          for (const Point2& q : found->second)
            if (distance_mm(p, q) <= reach_mm_) return true;
    return false;
  }

 private:
  [[nodiscard]] std::int64_t cell(double v_mm) const { return static_cast<std::int64_t>(std::floor(v_mm / reach_mm_)); }
  static std::int64_t key(std::int64_t i, std::int64_t j) { return i * (std::int64_t{1} << 32U) + j; }
  double reach_mm_;
  std::unordered_map<std::int64_t, std::vector<Point2>> cells_;
};

std::vector<Point2> apart(std::span<const Contour> from, std::span<const Contour> to, double reach_mm) {
  const Nearby nearby{to, reach_mm};
  std::vector<Point2> places;
  for (const Contour& ring : from)
    for (const Point2& p : ring.vertices())
      if (!nearby.runs_near(p)) places.push_back(p);
  return places;
}

}  // namespace

std::optional<Point2> DoubtfulPlaces::add_difference(std::span<const Contour> found, std::span<const Contour> other,
                                                     double width_mm) {
  for (const double share : kReachKernels) {
    const double reach = share * width_mm;
    if (!(reach > 0)) break;
    std::vector<Point2> places = apart(found, other, reach);
    const std::vector<Point2> more = apart(other, found, reach);
    places.insert(places.end(), more.begin(), more.end());
    for (const Point2& p : places) add(p, reach);
    if (!places.empty()) return places.front();
  }
  add_all();
  return std::nullopt;
}

std::vector<bool> DoubtfulPlaces::add_beside(std::span<const Contour> contours, std::span<const Point2> places,
                                             double reach_mm) {
  std::vector<bool> beside(places.size(), false);
  if (places.empty() || !(reach_mm > 0)) return beside;
  const Nearby nearby{contours, reach_mm};
  for (std::size_t i = 0; i < places.size(); ++i) {
    beside[i] = nearby.runs_near(places[i]);
    if (beside[i]) add(places[i], reach_mm);
  }
  return beside;
}

Result<void> DoubtfulPlaces::mark(Layer& layer) const {
  if (layer.contours.empty() || (places_.empty() && !all_)) return {};
  std::vector<std::vector<SurfaceRun>> runs;
  for (const Contour& ring : layer.contours) runs.push_back(one_an_edge(ring.runs(), ring.vertices().size()));
  if (all_)
    for (auto& ring : runs)
      for (SurfaceRun& run : ring) run.kind = SurfaceClass::Doubtful;
  for (const Place& place : all_ ? std::span<const Place>{} : std::span<const Place>{places_}) {
    double nearest = std::numeric_limits<double>::infinity();
    SurfaceRun* nearest_run = nullptr;
    for (std::size_t r = 0; r < layer.contours.size(); ++r) {
      const Bounds2 box = layer.contours[r].bounds();
      const double off = std::max({box.min.x_mm - place.at.x_mm, place.at.x_mm - box.max.x_mm,
                                   box.min.y_mm - place.at.y_mm, place.at.y_mm - box.max.y_mm});
      if (off > std::max(place.reach_mm, nearest)) continue;
      const auto v = layer.contours[r].vertices();
      for (std::size_t i = 0; i < v.size(); ++i) {
        const double distance = distance_to_edge(place.at, v[i], v[i + 1 == v.size() ? 0 : i + 1]);
        if (distance <= place.reach_mm) runs[r][i].kind = SurfaceClass::Doubtful;
        if (distance >= nearest) continue;
        nearest = distance;
        nearest_run = &runs[r][i];
      }
    }
    if (nearest_run && nearest > place.reach_mm) nearest_run->kind = SurfaceClass::Doubtful;
  }
  for (std::size_t r = 0; r < layer.contours.size(); ++r) {
    auto marked = layer.contours[r].with_runs(runs[r]);
    if (!marked) return fail(ErrorCode::Internal, marked.error().what);
    layer.contours[r] = std::move(*marked);
  }
  return {};
}

}  // namespace telefab::scan
