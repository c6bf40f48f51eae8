// SPDX-License-Identifier: GPL-3.0-or-later
#include "ring_nesting.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {
namespace {

__extension__ using Wide = __int128;

struct Spot {
  std::int64_t x = 0;
  std::int64_t y = 0;
  friend bool operator==(const Spot&, const Spot&) = default;
};

struct Edge {
  Spot a;  ///< the lower end, left one where level
  Spot b;
  std::int64_t left = 0;
  std::int64_t right = 0;
  std::uint32_t ring = 0;
  std::uint32_t number = 0;
};

Spot to_spot(Point2 p) { return {std::llround(p.x_mm * 1e6), std::llround(p.y_mm * 1e6)}; }

int side(Spot a, Spot b, Spot p) {
  const Wide cross = Wide{b.x - a.x} * (p.y - a.y) - Wide{b.y - a.y} * (p.x - a.x);
  return cross > 0 ? 1 : cross < 0 ? -1 : 0;
}

bool in_box(Spot a, Spot b, Spot p) {
  return std::min(a.x, b.x) <= p.x && p.x <= std::max(a.x, b.x) && std::min(a.y, b.y) <= p.y &&
         p.y <= std::max(a.y, b.y);
}

enum class Meeting { None, Touch, Cross };

/// Crossings no deeper than this are what rounding in a file makes of touching edges.
constexpr double kShallow = 1000;  // nanometres

double distance_to_line(const Edge& line, Spot p) {
  const double dx = static_cast<double>(line.b.x - line.a.x), dy = static_cast<double>(line.b.y - line.a.y);
  const double cross = dx * static_cast<double>(p.y - line.a.y) - dy * static_cast<double>(p.x - line.a.x);
  return std::abs(cross) / std::hypot(dx, dy);
}

/// How far one of two crossing edges would have to move for them to touch only.
double depth(const Edge& e, const Edge& f) {
  return std::min(
      {distance_to_line(e, f.a), distance_to_line(e, f.b), distance_to_line(f, e.a), distance_to_line(f, e.b)});
}

Meeting meet(const Edge& e, const Edge& f) {
  const int fa = side(e.a, e.b, f.a), fb = side(e.a, e.b, f.b);
  if (fa * fb > 0) return Meeting::None;
  const int ea = side(f.a, f.b, e.a), eb = side(f.a, f.b, e.b);
  if (ea * eb > 0) return Meeting::None;
  if (fa * fb < 0 && ea * eb < 0) return depth(e, f) > kShallow ? Meeting::Cross : Meeting::Touch;
  const bool touch = (fa == 0 && in_box(e.a, e.b, f.a)) || (fb == 0 && in_box(e.a, e.b, f.b)) ||
                     (ea == 0 && in_box(f.a, f.b, e.a)) || (eb == 0 && in_box(f.a, f.b, e.b));
  return touch ? Meeting::Touch : Meeting::None;
}

/// Neighbours share a vertex; they touch otherwise only where one folds back onto the other.
bool folds(const Edge& e, const Edge& f) {
  if (side(e.a, e.b, f.a) != 0 || side(e.a, e.b, f.b) != 0) return false;
  const auto within = [](const Edge& on, Spot p) { return !(p == on.a) && !(p == on.b) && in_box(on.a, on.b, p); };
  return within(e, f.a) || within(e, f.b) || within(f, e.a) || within(f, e.b) || (e.a == f.a && e.b == f.b);
}

Point2 crossing_of(const Edge& e, const Edge& f) {
  const double ex = static_cast<double>(e.b.x - e.a.x), ey = static_cast<double>(e.b.y - e.a.y);
  const double fx = static_cast<double>(f.b.x - f.a.x), fy = static_cast<double>(f.b.y - f.a.y);
  const double t =
      (static_cast<double>(f.a.x - e.a.x) * fy - static_cast<double>(f.a.y - e.a.y) * fx) / (ex * fy - ey * fx);
  return {(static_cast<double>(e.a.x) + t * ex) * 1e-6, (static_cast<double>(e.a.y) + t * ey) * 1e-6};
}

constexpr std::uint64_t kMostComparisons = 1'000'000'000;
constexpr std::size_t kMostStrips = 1U << 16U;

/// Edges by strips of equal height, each in every strip it reaches into.
class Strips {
 public:
  Strips(const std::vector<Edge>& edges) {
    std::int64_t low = edges.front().a.y, high = low;
    double heights = 0;
    for (const Edge& e : edges) {
      low = std::min(low, e.a.y);
      high = std::max(high, e.b.y);
      heights += static_cast<double>(e.b.y - e.a.y);
    }
    low_ = low;
    const double range = static_cast<double>(high - low) + 1;
    // As many strips as edges, but so few that all of them hold at most some eight entries an edge.
    const double count = static_cast<double>(edges.size());
    height_ = std::max({range / std::min(count, static_cast<double>(kMostStrips)), heights / (7 * count), 1.0});
    strips_.resize(static_cast<std::size_t>(range / height_) + 1);
    for (std::uint32_t i = 0; i < edges.size(); ++i)
      for (std::size_t s = of(edges[i].a.y); s <= of(edges[i].b.y); ++s) strips_[s].push_back(i);
  }
  [[nodiscard]] std::size_t of(std::int64_t y) const {
    return std::min(static_cast<std::size_t>(static_cast<double>(y - low_) / height_), strips_.size() - 1);
  }
  [[nodiscard]] std::vector<std::vector<std::uint32_t>>& all() { return strips_; }

 private:
  std::int64_t low_ = 0;
  double height_ = 1;
  std::vector<std::vector<std::uint32_t>> strips_;
};

tl::unexpected<Error> too_tangled() {
  return fail(ErrorCode::TooLarge, "too many edges lie side by side to be checked for crossings");
}

}  // namespace

Result<RingOrder> order_rings(const std::vector<std::vector<Point2>>& rings) {
  RingOrder order;
  std::vector<Edge> edges;
  std::vector<Spot> lowest;
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const auto& ring = rings[r];
    Spot least = to_spot(ring[0]);
    for (std::uint32_t i = 0; i < ring.size(); ++i) {
      Spot a = to_spot(ring[i]);
      Spot b = to_spot(ring[i + 1 == ring.size() ? 0 : i + 1]);
      if (a.y < least.y || (a.y == least.y && a.x < least.x)) least = a;
      if (b.y < a.y || (b.y == a.y && b.x < a.x)) std::swap(a, b);
      edges.push_back({a, b, std::min(a.x, b.x), std::max(a.x, b.x), r, i});
    }
    lowest.push_back(least);
  }
  if (edges.empty()) return order;
  const auto neighbours = [&](const Edge& e, const Edge& f) {
    if (e.ring != f.ring) return false;
    const std::uint32_t apart = e.number > f.number ? e.number - f.number : f.number - e.number;
    return apart == 1 || apart + 1 == rings[e.ring].size();
  };

  Strips strips{edges};
  std::uint64_t comparisons = 0;
  std::vector<std::uint32_t> active;
  for (auto& strip : strips.all()) {
    std::sort(strip.begin(), strip.end(), [&](std::uint32_t i, std::uint32_t j) {
      return edges[i].left != edges[j].left ? edges[i].left < edges[j].left : i < j;
    });
    active.clear();
    for (const std::uint32_t i : strip) {
      const Edge& e = edges[i];
      comparisons += active.size();
      if (comparisons > kMostComparisons) return too_tangled();
      std::size_t kept = 0;
      for (const std::uint32_t j : active) {
        const Edge& f = edges[j];
        if (f.right < e.left) continue;
        active[kept++] = j;
        if (f.a.y > e.b.y || f.b.y < e.a.y) continue;
        if (neighbours(e, f)) {
          order.touches = order.touches || folds(e, f);
          continue;
        }
        const Meeting meeting = meet(e, f);
        if (meeting == Meeting::Cross) {
          const Point2 place = crossing_of(e, f);
          if (!order.crossing || place.y_mm < order.crossing->y_mm ||
              (place.y_mm == order.crossing->y_mm && place.x_mm < order.crossing->x_mm))
            order.crossing = place;
        }
        order.touches = order.touches || meeting == Meeting::Touch;
      }
      active.resize(kept);
      active.push_back(i);
    }
    if (order.crossing) return order;
  }
  if (order.touches) return order;

  // A ray to the left from the lowest vertex of a ring: which other rings does it cross an odd number of times?
  std::vector<std::uint32_t> odd;
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const Spot p = lowest[r];
    odd.clear();
    const auto& strip = strips.all()[strips.of(p.y)];
    comparisons += strip.size();
    if (comparisons > kMostComparisons) return too_tangled();
    for (const std::uint32_t i : strip) {
      const Edge& e = edges[i];
      if (e.left > p.x) break;
      if (e.ring != r && e.a.y <= p.y && p.y < e.b.y && side(e.a, e.b, p) < 0) odd.push_back(e.ring);
    }
    std::sort(odd.begin(), odd.end());
    std::uint32_t depth = 0;
    for (std::size_t i = 0; i < odd.size();) {
      const std::size_t first = i;
      while (i < odd.size() && odd[i] == odd[first]) ++i;
      depth += (i - first) % 2;
    }
    order.depth.push_back(depth);
  }
  return order;
}

}  // namespace telefab::fab
