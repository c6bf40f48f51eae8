// SPDX-License-Identifier: GPL-3.0-or-later
#include "ring_check.hpp"

#include <algorithm>

#include "curve_fit.hpp"

namespace telefab::codec {
namespace {

constexpr std::uint64_t kMostComparisons = 200'000'000;

struct Edge {
  GridPoint a;  ///< the lower end
  GridPoint b;
  std::int32_t left = 0;
  std::int32_t right = 0;
  std::uint32_t ring = 0;
  std::uint32_t number = 0;
};

int side(GridPoint a, GridPoint b, GridPoint p) {
  const std::int64_t cross =
      (std::int64_t{b.x} - a.x) * (std::int64_t{p.y} - a.y) - (std::int64_t{b.y} - a.y) * (std::int64_t{p.x} - a.x);
  return cross > 0 ? 1 : cross < 0 ? -1 : 0;
}

bool between(GridPoint a, GridPoint b, GridPoint p) {
  return std::min(a.x, b.x) <= p.x && p.x <= std::max(a.x, b.x) && std::min(a.y, b.y) <= p.y &&
         p.y <= std::max(a.y, b.y);
}

bool meet(const Edge& e, const Edge& f) {
  const int fa = side(e.a, e.b, f.a);
  const int fb = side(e.a, e.b, f.b);
  if (fa * fb > 0) return false;
  const int ea = side(f.a, f.b, e.a);
  const int eb = side(f.a, f.b, e.b);
  if (ea * eb > 0) return false;
  if (fa != fb && ea != eb && fa * fb < 0 && ea * eb < 0) return true;
  return (fa == 0 && between(e.a, e.b, f.a)) || (fb == 0 && between(e.a, e.b, f.b)) ||
         (ea == 0 && between(f.a, f.b, e.a)) || (eb == 0 && between(f.a, f.b, e.b));
}

/// Of two edges with a common vertex: does one lie on the other?
bool fold(const Edge& e, const Edge& f) {
  if (side(e.a, e.b, f.a) != 0 || side(e.a, e.b, f.b) != 0) return false;
  const auto strictly_inside = [](const Edge& on, GridPoint p) {
    return !(p == on.a) && !(p == on.b) && between(on.a, on.b, p);
  };
  return strictly_inside(e, f.a) || strictly_inside(e, f.b) || strictly_inside(f, e.a) || strictly_inside(f, e.b) ||
         (e.a == f.a && e.b == f.b);
}

tl::unexpected<Error> too_complex() {
  return fail(ErrorCode::TooLarge, "the layer has too many edges side by side to be checked");
}

}  // namespace

Result<void> check_rings(std::span<const std::vector<GridPoint>> rings) {
  struct Box {
    GridPoint low, high;
  };
  std::vector<Edge> edges;
  std::vector<Box> boxes;
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const auto& ring = rings[r];
    Box box{ring[0], ring[0]};
    for (std::uint32_t i = 0; i < ring.size(); ++i) {
      GridPoint a = ring[i];
      GridPoint b = ring[i + 1 == ring.size() ? 0 : i + 1];
      box.low = {std::min(box.low.x, a.x), std::min(box.low.y, a.y)};
      box.high = {std::max(box.high.x, a.x), std::max(box.high.y, a.y)};
      if (b.y < a.y || (b.y == a.y && b.x < a.x)) std::swap(a, b);
      edges.push_back({a, b, std::min(a.x, b.x), std::max(a.x, b.x), r, i});
    }
    boxes.push_back(box);
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& e, const Edge& f) {
    return e.a.y != f.a.y ? e.a.y < f.a.y : e.ring != f.ring ? e.ring < f.ring : e.number < f.number;
  });
  const auto neighbours = [&](const Edge& e, const Edge& f) {
    if (e.ring != f.ring) return false;
    const std::uint32_t apart = e.number > f.number ? e.number - f.number : f.number - e.number;
    return apart == 1 || apart + 1 == rings[e.ring].size();
  };
  std::uint64_t comparisons = 0;
  std::vector<Edge> active;
  for (const Edge& e : edges) {
    comparisons += active.size();
    if (comparisons > kMostComparisons) return too_complex();
    std::size_t kept = 0;
    for (std::size_t i = 0; i < active.size(); ++i) {
      const Edge& f = active[i];
      if (f.b.y < e.a.y) continue;
      if (f.left <= e.right && f.right >= e.left && (neighbours(e, f) ? fold(e, f) : meet(e, f)))
        return fail(ErrorCode::ProtocolBroken, "contours cross or touch");
      if (kept != i) active[kept] = f;
      ++kept;
    }
    active.resize(kept);
    active.push_back(e);
  }

  for (std::size_t r = 0; r < rings.size(); ++r) {
    const GridPoint p = rings[r][0];
    bool inside = false;
    comparisons += rings.size();
    if (comparisons > kMostComparisons) return too_complex();
    for (std::size_t o = 0; o < rings.size(); ++o) {
      if (o == r || p.x < boxes[o].low.x || p.y < boxes[o].low.y || p.x > boxes[o].high.x || p.y > boxes[o].high.y)
        continue;
      const auto& ring = rings[o];
      comparisons += ring.size();
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const GridPoint a = ring[i];
        const GridPoint b = ring[i + 1 == ring.size() ? 0 : i + 1];
        if ((a.y > p.y) != (b.y > p.y) && (side(a, b, p) > 0) == (b.y > a.y)) inside = !inside;
      }
    }
    if (inside == (twice_area(std::span<const GridPoint>{rings[r]}) > 0))
      return fail(ErrorCode::ProtocolBroken,
                  inside ? "an outer ring lies where a hole belongs" : "a hole lies outside of every outer ring");
  }
  return {};
}

}  // namespace telefab::codec
