// SPDX-License-Identifier: GPL-3.0-or-later
#include "stability.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "convex_hull.hpp"

namespace telefab::fab {
namespace {

constexpr double kLeastLean = 0.05;  ///< slack wanted per millimetre of height of the centre of mass
constexpr int kMostAdded = 9;

double cross(Point2 o, Point2 a, Point2 b) {
  return (a.x_mm - o.x_mm) * (b.y_mm - o.y_mm) - (a.y_mm - o.y_mm) * (b.x_mm - o.x_mm);
}

/// Signed distance of p to the hull's boundary, positive inside, and the outward direction at the nearest place.
std::pair<double, Point2> inside_by(const std::vector<Point2>& hull, Point2 p) {
  double nearest = std::numeric_limits<double>::infinity();
  Point2 way{1, 0};
  bool inside = hull.size() >= 3;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const Point2 a = hull[i], b = hull[i + 1 < hull.size() ? i + 1 : 0];
    const double vx = b.x_mm - a.x_mm, vy = b.y_mm - a.y_mm, length2 = vx * vx + vy * vy;
    const double t =
        length2 > 0 ? std::clamp(((p.x_mm - a.x_mm) * vx + (p.y_mm - a.y_mm) * vy) / length2, 0.0, 1.0) : 0.0;
    const double dx = p.x_mm - a.x_mm - t * vx, dy = p.y_mm - a.y_mm - t * vy, d = std::hypot(dx, dy);
    if (hull.size() >= 3 && cross(a, b, p) < 0) inside = false;
    if (d >= nearest) continue;
    nearest = d;
    const double length = std::sqrt(length2);
    // Across the edge; of a single pin, away from it.
    if (length > 0)
      way = {vy / length, -vx / length};
    else if (d > 0)
      way = {dx / d, dy / d};
  }
  return {inside ? nearest : -nearest, way};
}

struct Mass {
  double area = 0;
  Point2 moment;  ///< area times place
};

Mass mass_of(const Region& region) {
  Mass mass;
  for (const GridRing& ring : region.rings()) {
    const Point2 o = to_mm(ring.front());
    double twice = 0, mx = 0, my = 0;
    for (std::size_t i = 1; i + 1 < ring.size(); ++i) {
      const Point2 a = to_mm(ring[i]), b = to_mm(ring[i + 1]);
      const double c = cross(o, a, b);
      twice += c;
      mx += c * (o.x_mm + a.x_mm + b.x_mm) / 3;
      my += c * (o.y_mm + a.y_mm + b.y_mm) / 3;
    }
    mass.area += twice / 2;
    mass.moment = {mass.moment.x_mm + mx / 2, mass.moment.y_mm + my / 2};
  }
  return mass;
}

}  // namespace

Stability stability_of(std::span<const Region> layers, std::span<const Anchor> anchors, bool stands,
                       const MachineProfile& machine) {
  const double thickness_mm = machine.layers.thickness_mm;
  Stability worst;
  worst.slack_mm = std::numeric_limits<double>::infinity();
  std::vector<Point2> holds;
  if (stands && !layers.empty())
    for (const GridRing& ring : layers.front().rings())
      for (const GridPoint& p : ring) holds.push_back(to_mm(p));
  std::vector<Anchor> sorted(anchors.begin(), anchors.end());
  std::stable_sort(sorted.begin(), sorted.end(), [](const Anchor& a, const Anchor& b) { return a.layer < b.layer; });
  std::vector<Point2> hull = convex_hull(holds);
  std::size_t next = 0;
  double area = 0, height_moment = 0;
  Point2 moment;
  for (std::size_t k = 0; k < layers.size(); ++k) {
    const std::size_t before = next;
    for (; next < sorted.size() && sorted[next].layer.count() <= k; ++next) holds.push_back(sorted[next].place);
    if (next != before) {
      hull.insert(hull.end(), holds.end() - static_cast<std::ptrdiff_t>(next - before), holds.end());
      hull = convex_hull(std::move(hull));
    }
    const Mass mass = mass_of(layers[k]);
    area += mass.area;
    moment = {moment.x_mm + mass.moment.x_mm, moment.y_mm + mass.moment.y_mm};
    const double height = (static_cast<double>(k) + 0.5) * thickness_mm;
    height_moment += mass.area * height;
    if (!(area > 0) || hull.empty()) continue;
    const Point2 centre{moment.x_mm / area, moment.y_mm / area};
    const auto [inside, way] = inside_by(hull, centre);
    const double slack = inside + machine.supports.tip_radius_mm - kLeastLean * height_moment / area;
    if (slack < worst.slack_mm) worst = {slack, LayerIndex{static_cast<std::uint32_t>(k)}, centre, way};
  }
  if (!std::isfinite(worst.slack_mm)) worst = {};
  return worst;
}

std::vector<Anchor> stabilising_anchors(std::span<const Region> layers, std::span<const Anchor> anchors,
                                        const MachineProfile& machine) {
  const double t = machine.layers.thickness_mm, tip = machine.supports.tip_radius_mm;
  // Higher up a pin is long, and what it could stabilise has tipped already.
  const double most_mm =
      std::max(0.3 * t * static_cast<double>(layers.size()), 2 * machine.supports.anchor_distance_mm);
  const auto last = std::min<std::size_t>(layers.size(), static_cast<std::size_t>(most_mm / t) + 1);
  // Over a tip there must be nothing of the part but what it holds.
  const auto room = static_cast<std::size_t>(std::ceil(2 * tip / t));
  const std::size_t step = std::max<std::size_t>(1, last / 60);
  std::vector<Anchor> places;  // on the underside, a tip's radius inside the contour
  for (std::size_t k = 1; k < last; k += step) {
    const Region inner = offset(layers[k], Millimetres{-tip}, Millimetres{tip / 4});
    for (const GridRing& ring : inner.rings())
      for (std::size_t i = 0; i < ring.size(); i += std::max<std::size_t>(1, ring.size() / 48))
        if (const Point2 p = to_mm(ring[i]); !layers[k - std::min(k, room)].contains(p))
          places.push_back({p, LayerIndex{static_cast<std::uint32_t>(k)}, false, false});
  }
  std::vector<Anchor> all(anchors.begin(), anchors.end()), added;
  Stability now = stability_of(layers, all, false, machine);
  while (now.slack_mm < 0 && static_cast<int>(added.size()) < kMostAdded) {
    // The place that gains most; among equals the lowest.
    const Anchor* best = nullptr;
    double farthest = 0;
    for (const Anchor& place : places) {
      if (place.layer > now.layer) continue;
      const double gain =
          (place.place.x_mm - now.centre.x_mm) * now.lean.x_mm + (place.place.y_mm - now.centre.y_mm) * now.lean.y_mm;
      // Enough is enough: beyond what this moment asks for a lower place is worth more.
      const double worth = std::min(gain, 2 * std::abs(now.slack_mm) + 4 * tip) - 0.02 * place.layer.count() * t;
      if (best == nullptr || worth > farthest) best = &place, farthest = worth;
    }
    if (best == nullptr) break;
    all.push_back(*best);
    const Stability then = stability_of(layers, all, false, machine);
    // The first of two pins that are still in a line gains nothing yet.
    if (then.slack_mm <= now.slack_mm && added.size() >= 2 && then.layer == now.layer) break;
    added.push_back(*best);
    std::erase_if(places, [&, at = added.back().place](const Anchor& place) {
      return std::hypot(place.place.x_mm - at.x_mm, place.place.y_mm - at.y_mm) < 4 * tip;
    });
    now = then;
  }
  return added;
}

}  // namespace telefab::fab
