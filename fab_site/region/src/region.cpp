// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <polyclipping/clipper.hpp>
#include <telefab/base/disjoint_sets.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/geometry/limits.hpp>
#include <tuple>

namespace cl = ClipperLib;

namespace telefab::fab {

struct RegionMaker {
  static Region make(std::vector<GridRing> rings) { return Region{std::move(rings)}; }
};

namespace {

constexpr std::int64_t kMaxGrid = static_cast<std::int64_t>(kMaxCoordinateMm * kGridStepsPerMm);

cl::Path to_path(const GridRing& ring) {
  cl::Path path;
  path.reserve(ring.size());
  for (const GridPoint& p : ring) path.emplace_back(p.x, p.y);
  return path;
}

cl::Paths to_paths(std::span<const GridRing> rings) {
  cl::Paths paths;
  paths.reserve(rings.size());
  for (const GridRing& ring : rings) paths.push_back(to_path(ring));
  return paths;
}

GridRing to_ring(const cl::Path& path) {
  GridRing ring;
  ring.reserve(path.size());
  for (const cl::IntPoint& p : path) ring.push_back({p.X, p.Y});
  return ring;
}

Region to_region(const cl::Paths& paths) {
  std::vector<GridRing> rings;
  rings.reserve(paths.size());
  for (const cl::Path& path : paths)
    if (path.size() >= 3) rings.push_back(to_ring(path));
  return RegionMaker::make(std::move(rings));
}

using Box = std::pair<GridPoint, GridPoint>;

Box box_of(const GridRing& ring) {
  GridPoint least = ring.front(), most = least;
  for (const GridPoint& p : ring) {
    least = {std::min(least.x, p.x), std::min(least.y, p.y)};
    most = {std::max(most.x, p.x), std::max(most.y, p.y)};
  }
  return {least, most};
}

/// A number for every box, the same for boxes that hang together by touching or overlapping ones; counted from 0 in
/// the order of first appearance.
std::vector<std::uint32_t> groups_of(const std::vector<Box>& boxes, std::uint32_t& count) {
  DisjointSets sets{boxes.size()};
  std::vector<std::uint32_t> order(boxes.size()), active;
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return boxes[a].first.y != boxes[b].first.y ? boxes[a].first.y < boxes[b].first.y : a < b;
  });
  for (const std::uint32_t i : order) {
    std::erase_if(active, [&](std::uint32_t j) { return boxes[j].second.y < boxes[i].first.y; });
    for (const std::uint32_t j : active)
      if (boxes[j].first.x <= boxes[i].second.x && boxes[j].second.x >= boxes[i].first.x) sets.join(i, j);
    active.push_back(i);
  }
  const std::vector<std::uint32_t> group = sets.numbers();
  count = group.empty() ? 0 : *std::max_element(group.begin(), group.end()) + 1;
  return group;
}

constexpr std::size_t kFewRings = 12;  ///< below which sorting them apart costs more than it saves

/// Clipper's time grows with the edges that one scan line meets. Rings whose boxes are apart have nothing to do with
/// each other, so every group of rings is combined alone.
Region combined(cl::ClipType kind, std::span<const GridRing> a, std::span<const GridRing> b, cl::PolyFillType fill) {
  cl::Paths out;
  std::uint32_t count = 1;
  std::vector<std::uint32_t> group;
  if (a.size() + b.size() >= kFewRings) {
    std::vector<Box> boxes;
    for (const auto& rings : {a, b})
      for (const GridRing& ring : rings)
        boxes.push_back(ring.empty() ? Box{} : box_of(ring));  // an empty ring adds nothing wherever it goes
    group = groups_of(boxes, count);
  }
  if (count <= 1) {
    cl::Clipper clipper;
    clipper.AddPaths(to_paths(a), cl::ptSubject, true);
    clipper.AddPaths(to_paths(b), cl::ptClip, true);
    clipper.Execute(kind, out, fill, fill);
    return to_region(out);
  }
  std::vector<cl::Paths> subject(count), clip(count);
  for (std::size_t i = 0; i < a.size(); ++i) subject[group[i]].push_back(to_path(a[i]));
  for (std::size_t i = 0; i < b.size(); ++i) clip[group[a.size() + i]].push_back(to_path(b[i]));
  for (std::uint32_t g = 0; g < count; ++g) {
    if (subject[g].empty() && kind != cl::ctUnion) continue;
    if (clip[g].empty() && kind == cl::ctIntersection) continue;
    if (clip[g].empty() && kind == cl::ctDifference) {  // as it came, from Clipper
      out.insert(out.end(), subject[g].begin(), subject[g].end());
      continue;
    }
    cl::Clipper clipper;
    clipper.AddPaths(subject[g], cl::ptSubject, true);
    clipper.AddPaths(clip[g], cl::ptClip, true);
    cl::Paths part;
    clipper.Execute(kind, part, fill, fill);
    out.insert(out.end(), part.begin(), part.end());
  }
  return to_region(out);
}

double ring_area(const GridRing& ring) {
  // Relative to the first vertex: the products stay small, the sum exact for any ring that fits a platform.
  double twice = 0;
  const GridPoint o = ring.front();
  for (std::size_t i = 1; i + 1 < ring.size(); ++i) {
    const double ax = static_cast<double>(ring[i].x - o.x), ay = static_cast<double>(ring[i].y - o.y);
    const double bx = static_cast<double>(ring[i + 1].x - o.x), by = static_cast<double>(ring[i + 1].y - o.y);
    twice += ax * by - ay * bx;
  }
  return twice / 2;
}

GridPoint lowest(const GridRing& ring) {
  return *std::min_element(ring.begin(), ring.end(),
                           [](const GridPoint& a, const GridPoint& b) { return a.y != b.y ? a.y < b.y : a.x < b.x; });
}

bool boxes_apart(const Region& a, const Region& b) {
  const Bounds2 p = a.bounds(), q = b.bounds();
  return p.max.x_mm < q.min.x_mm || q.max.x_mm < p.min.x_mm || p.max.y_mm < q.min.y_mm || q.max.y_mm < p.min.y_mm;
}

double distance_squared(const GridPoint& p, const GridPoint& a, const GridPoint& b) {
  const double vx = static_cast<double>(b.x - a.x), vy = static_cast<double>(b.y - a.y);
  const double wx = static_cast<double>(p.x - a.x), wy = static_cast<double>(p.y - a.y);
  const double length2 = vx * vx + vy * vy;
  const double t = length2 > 0 ? std::clamp((wx * vx + wy * vy) / length2, 0.0, 1.0) : 0.0;
  const double dx = wx - t * vx, dy = wy - t * vy;
  return dx * dx + dy * dy;
}

enum class Side { Out, In, On };

/// Exact for any platform below 4 m: products of differences fit the 64 bits of a long double.
Side side_of(const GridRing& ring, GridPoint p) {
  bool in = false;
  GridPoint a = ring.back();
  for (const GridPoint& b : ring) {
    if (a == p || b == p) return Side::On;
    if (a.y == b.y) {
      if (a.y == p.y && (a.x < p.x) != (b.x < p.x)) return Side::On;
    } else if ((a.y <= p.y) != (b.y <= p.y)) {
      const auto left = static_cast<long double>(b.x - a.x) * static_cast<long double>(p.y - a.y);
      const auto right = static_cast<long double>(p.x - a.x) * static_cast<long double>(b.y - a.y);

      if (left == right) return Side::On;
      if ((left > right) == (b.y > a.y)) in = !in;
    }
    a = b;
  }
  return in ? Side::In : Side::Out;
}

GridRing thinned(const GridRing& ring, double tolerance2) {
  const std::size_t n = ring.size();
  std::size_t far = 0;
  double best = -1;
  for (std::size_t i = 1; i < n; ++i)
    if (const double d = distance_squared(ring[i], ring[0], ring[0]); d > best) best = d, far = i;
  std::vector<char> keep(n, 0);
  keep[0] = keep[far] = 1;
  std::vector<std::pair<std::size_t, std::size_t>> open{{0, far}, {far, n}};
  while (!open.empty()) {
    const auto [first, last] = open.back();
    open.pop_back();
    std::size_t worst = 0;
    double reach = tolerance2;
    for (std::size_t i = first + 1; i < last; ++i)
      if (const double d = distance_squared(ring[i], ring[first], ring[last % n]); d > reach) reach = d, worst = i;
    if (worst == 0) continue;
    keep[worst] = 1;
    open.emplace_back(first, worst);
    open.emplace_back(worst, last);
  }
  GridRing out;
  for (std::size_t i = 0; i < n; ++i)
    if (keep[i]) out.push_back(ring[i]);
  return out;
}

}  // namespace

GridPoint to_grid(Point2 point) {
  return {static_cast<std::int64_t>(std::llround(point.x_mm * kGridStepsPerMm)),
          static_cast<std::int64_t>(std::llround(point.y_mm * kGridStepsPerMm))};
}

Point2 to_mm(GridPoint point) {
  return {static_cast<double>(point.x) / kGridStepsPerMm, static_cast<double>(point.y) / kGridStepsPerMm};
}

double area_mm2(const GridRing& ring) { return ring_area(ring) / (kGridStepsPerMm * kGridStepsPerMm); }

Result<Region> Region::from_contours(std::span<const Contour> contours) {
  std::vector<GridRing> rings;
  rings.reserve(contours.size());
  for (const Contour& contour : contours) {
    GridRing ring;
    ring.reserve(contour.vertices().size());
    for (const Point2& p : contour.vertices()) {
      if (!(std::abs(p.x_mm) <= kMaxCoordinateMm && std::abs(p.y_mm) <= kMaxCoordinateMm))
        return fail(ErrorCode::InvalidInput,
                    fmt::format("a region's vertex ({}, {}) lies beyond {} mm", p.x_mm, p.y_mm, kMaxCoordinateMm));
      ring.push_back(to_grid(p));
    }
    rings.push_back(std::move(ring));
  }
  return from_rings(rings);
}

Result<Region> Region::from_rings(std::span<const GridRing> rings, bool even_odd) {
  for (const GridRing& ring : rings)
    for (const GridPoint& p : ring)
      if (p.x < -kMaxGrid || p.x > kMaxGrid || p.y < -kMaxGrid || p.y > kMaxGrid)
        return fail(ErrorCode::InvalidInput, fmt::format("a region's vertex lies beyond {} mm", kMaxCoordinateMm));
  return combined(cl::ctUnion, rings, {}, even_odd ? cl::pftEvenOdd : cl::pftPositive);
}

std::vector<Contour> Region::to_contours() const {
  std::vector<Contour> contours;
  contours.reserve(rings_.size());
  for (const GridRing& ring : rings_) {
    std::vector<Point2> vertices;
    vertices.reserve(ring.size());
    for (const GridPoint& p : ring)
      if (const Point2 mm = to_mm(p); vertices.empty() || !(vertices.back() == mm)) vertices.push_back(mm);
    if (vertices.size() > 1 && vertices.front() == vertices.back()) vertices.pop_back();
    if (auto contour = Contour::from_vertices(std::move(vertices))) contours.push_back(std::move(*contour));
  }
  return sorted_canonically(std::move(contours));
}

double Region::area_mm2() const {
  double area = 0;
  for (const GridRing& ring : rings_) area += ring_area(ring);
  return area / (kGridStepsPerMm * kGridStepsPerMm);
}

Bounds2 Region::bounds() const {
  if (rings_.empty()) return {};
  GridPoint least = rings_.front().front(), most = least;
  for (const GridRing& ring : rings_)
    for (const GridPoint& p : ring) {
      least = {std::min(least.x, p.x), std::min(least.y, p.y)};
      most = {std::max(most.x, p.x), std::max(most.y, p.y)};
    }
  return {to_mm(least), to_mm(most)};
}

bool Region::contains(Point2 point) const {
  const GridPoint p = to_grid(point);
  int winding = 0;
  for (const GridRing& ring : rings_) {
    const Side side = side_of(ring, p);
    if (side == Side::On) return true;
    if (side == Side::In) winding += ring_area(ring) > 0 ? 1 : -1;
  }
  return winding > 0;
}

std::vector<Region> Region::pieces() const {
  std::vector<Region> found;
  if (rings_.size() <= 1) {
    if (!rings_.empty()) found.push_back(*this);
    return found;
  }
  struct Outer {
    std::vector<GridRing> rings;
    GridPoint least, most;
    double area;
  };
  std::vector<Outer> outers;
  for (const GridRing& ring : rings_)
    if (const double area = ring_area(ring); area > 0) {
      const auto [least, most] = box_of(ring);
      outers.push_back({{ring}, least, most, area});
    }
  for (const GridRing& hole : rings_) {
    if (ring_area(hole) > 0) continue;
    // The smallest outer ring around it; rings may touch, so the first vertex off the boundary decides.
    Outer* around = nullptr;
    for (Outer& outer : outers) {
      if (around != nullptr && outer.area >= around->area) continue;
      const GridPoint& p = hole.front();
      if (p.x < outer.least.x || p.x > outer.most.x || p.y < outer.least.y || p.y > outer.most.y) continue;
      for (const GridPoint& q : hole) {
        const Side side = side_of(outer.rings.front(), q);
        if (side == Side::In) around = &outer;
        if (side != Side::On) break;
      }
    }
    if (around != nullptr) around->rings.push_back(hole);
  }
  for (Outer& outer : outers) found.push_back(Region{std::move(outer.rings)});
  std::stable_sort(found.begin(), found.end(), [](const Region& a, const Region& b) {
    const GridPoint p = lowest(a.rings_.front()), q = lowest(b.rings_.front());
    return p.y != q.y ? p.y < q.y : p.x < q.x;
  });
  return found;
}

Region unite(const Region& a, const Region& b) {
  if (a.empty()) return b;
  if (b.empty()) return a;
  return combined(cl::ctUnion, a.rings(), b.rings(), cl::pftPositive);
}

namespace {

Region united_rings(std::span<const Region* const> regions) {
  std::vector<GridRing> rings;
  for (const Region* region : regions) rings.insert(rings.end(), region->rings().begin(), region->rings().end());
  return combined(cl::ctUnion, rings, {}, cl::pftPositive);
}

/// A ring that Clipper would give back as it is: counter-clockwise, turning left at every vertex, once around.
bool is_strictly_convex(const GridRing& ring) {
  constexpr std::int64_t kMostSide = std::int64_t{1} << 31U;  // so that products of differences are exact
  const auto [least, most] = box_of(ring);
  if (ring.size() < 3 || most.x - least.x >= kMostSide || most.y - least.y >= kMostSide) return false;
  int turns = 0;  // from down or level to up
  const std::size_t n = ring.size();
  for (std::size_t i = 0; i < n; ++i) {
    const GridPoint a = ring[i], b = ring[(i + 1) % n], c = ring[(i + 2) % n];
    if ((b.x - a.x) * (c.y - b.y) - (b.y - a.y) * (c.x - b.x) <= 0) return false;
    turns += b.y <= a.y && c.y > b.y;
  }
  return turns == 1;
}

/// Both as Clipper gives them. Of what meets nothing of the other nothing changes.
Region united_apart(const Region& a, const Region& b) {
  std::vector<Box> boxes;
  for (const Region* region : {&a, &b})
    for (const GridRing& ring : region->rings()) boxes.push_back(box_of(ring));
  std::uint32_t count = 0;
  const auto group = groups_of(boxes, count);
  std::vector<char> has_a(count, 0), has_b(count, 0);
  for (std::size_t i = 0; i < group.size(); ++i) (i < a.rings().size() ? has_a : has_b)[group[i]] = 1;
  std::vector<GridRing> apart, meeting;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const GridRing& ring = i < a.rings().size() ? a.rings()[i] : b.rings()[i - a.rings().size()];
    (has_a[group[i]] && has_b[group[i]] ? meeting : apart).push_back(ring);
  }
  const Region united = combined(cl::ctUnion, meeting, {}, cl::pftPositive);
  apart.insert(apart.end(), united.rings().begin(), united.rings().end());
  return RegionMaker::make(std::move(apart));
}

/// Halves are united first: where many overlap, what is covered already is gone before the next is added.
Region united_halves(std::span<const Region* const> regions) {
  constexpr std::size_t kAtOnce = 16;
  if (regions.size() <= kAtOnce) {
    std::vector<const Region*> some;
    for (const Region* region : regions)
      if (region) some.push_back(region);
    return united_rings(some);
  }
  const std::size_t half = regions.size() / 2;
  return united_apart(united_halves(regions.first(half)), united_halves(regions.subspan(half)));
}

/// Which of so many regions lie in a box that meets no other's.
std::vector<char> alone_of(std::span<const Region* const> regions) {
  std::vector<Box> boxes;
  for (const Region* region : regions) {
    Box whole = box_of(region->rings().front());
    for (const GridRing& ring : region->rings().subspan(1)) {
      const Box box = box_of(ring);
      whole.first = {std::min(whole.first.x, box.first.x), std::min(whole.first.y, box.first.y)};
      whole.second = {std::max(whole.second.x, box.second.x), std::max(whole.second.y, box.second.y)};
    }
    boxes.push_back(whole);
  }
  std::uint32_t count = 0;
  const auto group = groups_of(boxes, count);
  std::vector<std::uint32_t> size(count, 0);
  for (const std::uint32_t g : group) ++size[g];
  std::vector<char> alone(boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) alone[i] = size[group[i]] == 1;
  return alone;
}

}  // namespace

Region unite(std::span<const Region> regions) {
  constexpr std::size_t kMany = 64;
  std::vector<const Region*> all;
  for (const Region& region : regions)
    if (!region.empty()) all.push_back(&region);
  if (all.size() < kMany) return united_rings(all);
  // In bands of rows, so that what lies together is united together.
  std::vector<Box> boxes;
  Box whole = box_of(all.front()->rings().front());
  for (const Region* region : all) {
    boxes.push_back(box_of(region->rings().front()));
    whole.first.y = std::min(whole.first.y, boxes.back().first.y);
    whole.second.y = std::max(whole.second.y, boxes.back().second.y);
  }
  const auto bands = static_cast<std::int64_t>(std::sqrt(static_cast<double>(all.size()) / 2));
  const std::int64_t band = std::max<std::int64_t>(1, (whole.second.y - whole.first.y) / bands);
  std::vector<std::size_t> order(all.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto key = [&](std::size_t i) {
    return std::tuple{(boxes[i].first.y - whole.first.y) / band, boxes[i].first.x, boxes[i].first.y, i};
  };
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  // Most sections of pins stand alone.
  const std::vector<char> alone = alone_of(all);
  std::vector<const Region*> sorted;
  std::vector<GridRing> rings;
  for (const std::size_t i : order) {
    const std::span<const GridRing> own = all[i]->rings();
    const bool stays = alone[i] && own.size() == 1 && is_strictly_convex(own.front());
    if (stays) rings.push_back(own.front());
    sorted.push_back(stays ? nullptr : all[i]);
  }
  const Region united = united_halves(sorted);
  rings.insert(rings.end(), united.rings().begin(), united.rings().end());
  return RegionMaker::make(std::move(rings));
}

Region intersect(const Region& a, const Region& b) {
  if (a.empty() || b.empty() || boxes_apart(a, b)) return {};
  return combined(cl::ctIntersection, a.rings(), b.rings(), cl::pftPositive);
}

Region subtract(const Region& a, const Region& b) {
  if (a.empty() || b.empty() || boxes_apart(a, b)) return a;
  return combined(cl::ctDifference, a.rings(), b.rings(), cl::pftPositive);
}

Region offset(const Region& region, Millimetres distance, Millimetres arc_tolerance) {
  if (region.empty() || distance.count() == 0) return region;
  cl::ClipperOffset maker{2.0, std::max(1.0, arc_tolerance.count() * kGridStepsPerMm)};
  maker.AddPaths(to_paths(region.rings()), cl::jtRound, cl::etClosedPolygon);
  cl::Paths out;
  maker.Execute(out, distance.count() * kGridStepsPerMm);
  return to_region(out);
}

Region simplified(const Region& region, Millimetres tolerance) {
  const double reach = tolerance.count() * kGridStepsPerMm;
  std::vector<GridRing> rings;
  for (const GridRing& ring : region.rings())
    if (GridRing thin = thinned(ring, reach * reach); thin.size() >= 3) rings.push_back(std::move(thin));
  return combined(cl::ctUnion, rings, {}, cl::pftPositive);
}

Point2 inner_point(const Region& region) {
  if (region.empty()) return {};
  const auto [least, most] = box_of(region.rings().front());
  // Between grid lines, so that no vertex lies on the line.
  const double level = static_cast<double>(least.y) + std::floor(static_cast<double>(most.y - least.y) / 2) + 0.5;
  std::vector<double> at;
  for (const GridRing& ring : region.rings())
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const GridPoint a = ring[i], b = ring[i + 1 < ring.size() ? i + 1 : 0];
      const double ay = static_cast<double>(a.y), by = static_cast<double>(b.y);
      if ((ay < level) == (by < level)) continue;
      at.push_back(static_cast<double>(a.x) + (level - ay) / (by - ay) * static_cast<double>(b.x - a.x));
    }
  std::sort(at.begin(), at.end());
  double widest = -1, x = static_cast<double>(region.rings().front().front().x);
  for (std::size_t i = 0; i + 1 < at.size(); i += 2)
    if (at[i + 1] - at[i] > widest) widest = at[i + 1] - at[i], x = (at[i] + at[i + 1]) / 2;
  return {x / kGridStepsPerMm, level / kGridStepsPerMm};
}

Region disc(Point2 centre, Millimetres radius, Millimetres arc_tolerance) {
  const double r = radius.count();
  if (!(r > 0)) return {};
  const double step = 2 * std::acos(std::clamp(1 - arc_tolerance.count() / r, 0.5, 1.0 - 1e-6));
  const int n = std::max(8, static_cast<int>(std::ceil(2 * std::numbers::pi / step)));
  GridRing ring;
  for (int i = 0; i < n; ++i) {
    const double a = 2 * std::numbers::pi * i / n;
    ring.push_back(to_grid({centre.x_mm + r * std::cos(a), centre.y_mm + r * std::sin(a)}));
  }
  ring.erase(std::unique(ring.begin(), ring.end()), ring.end());
  if (ring.size() > 1 && ring.front() == ring.back()) ring.pop_back();
  if (ring.size() < 3) return {};
  return RegionMaker::make({std::move(ring)});
}

}  // namespace telefab::fab
