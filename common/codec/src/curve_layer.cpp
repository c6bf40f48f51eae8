// SPDX-License-Identifier: GPL-3.0-or-later
#include "curve_layer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telefab::codec {
namespace {

constexpr double kCheapMotion = 4;  ///< bits a vertex, below which nothing else is tried
constexpr std::size_t kMostPairs = 4'000'000;

struct Box {
  double low_x = 1e30, low_y = 1e30, high_x = -1e30, high_y = -1e30;
  void add(double x, double y) {
    low_x = std::min(low_x, x);
    low_y = std::min(low_y, y);
    high_x = std::max(high_x, x);
    high_y = std::max(high_y, y);
  }
  [[nodiscard]] double gap(const Box& o) const {
    return std::abs(low_x - o.low_x) + std::abs(low_y - o.low_y) + std::abs(high_x - o.high_x) +
           std::abs(high_y - o.high_y);
  }
};

struct Pair {
  double gap;
  std::size_t ring;
  std::size_t reference;
};

/// For each ring the one below that looks most like it, each at most once.
std::vector<std::optional<std::size_t>> references(const std::vector<std::vector<Place>>& targets,
                                                   const std::vector<MovingRing>& below) {
  std::vector<std::optional<std::size_t>> of(targets.size());
  if (targets.size() * below.size() > kMostPairs) return of;
  std::vector<Box> boxes(below.size());
  std::vector<bool> outer(below.size());
  for (std::size_t b = 0; b < below.size(); ++b) {
    double area = 0;
    for (std::size_t i = 0; i < below[b].size(); ++i) {
      const GridPoint p = below[b][i].at;
      const GridPoint q = below[b][i + 1 == below[b].size() ? 0 : i + 1].at;
      boxes[b].add(p.x, p.y);
      area += static_cast<double>(p.x) * q.y - static_cast<double>(q.x) * p.y;
    }
    outer[b] = area > 0;
  }
  std::vector<Pair> pairs;
  for (std::size_t r = 0; r < targets.size(); ++r) {
    Box box;
    for (const Place p : targets[r]) box.add(p.x, p.y);
    const bool is_outer = twice_area(targets[r]) > 0;
    const double size = box.high_x - box.low_x + box.high_y - box.low_y;
    for (std::size_t b = 0; b < below.size(); ++b)
      if (outer[b] == is_outer && box.gap(boxes[b]) < size) pairs.push_back({box.gap(boxes[b]), r, b});
  }
  std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) {
    return a.gap != b.gap ? a.gap < b.gap : a.ring != b.ring ? a.ring < b.ring : a.reference < b.reference;
  });
  std::vector<bool> taken(below.size());
  for (const Pair& pair : pairs) {
    if (of[pair.ring] || taken[pair.reference]) continue;
    of[pair.ring] = pair.reference;
    taken[pair.reference] = true;
  }
  return of;
}

}  // namespace

LayerFit fit_layer(const Layer& layer, const Grid& grid, const CurveState& state, const FitRule& rule, bool exact) {
  std::vector<std::vector<Place>> targets;
  for (const Contour& contour : layer.contours) {
    std::vector<Place> ring;
    ring.reserve(contour.vertices().size());
    for (const Point2 v : contour.vertices()) ring.push_back(grid.place(v));
    targets.push_back(std::move(ring));
  }
  const auto reference = references(targets, state.reference_layer);
  // Rings that move in the order of the rings below, so that a reference is mostly "the next"; new ones behind.
  std::vector<std::size_t> order(targets.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return reference[a].value_or(state.reference_layer.size()) < reference[b].value_or(state.reference_layer.size());
  });
  LayerFit layer_fit;
  for (const std::size_t r : order) {
    std::optional<RingFit> best;
    if (reference[r] && !exact) best = fit_motion(state.reference_layer[*reference[r]], targets[r], state.models, rule);
    if (best) best->plan.reference = static_cast<std::uint32_t>(*reference[r]);
    if (!best || best->cost_bits > kCheapMotion * static_cast<double>(best->ring.size())) {
      auto intra = fit_intra(targets[r], state.models, rule, exact);
      if (intra && (!best || intra->cost_bits < best->cost_bits)) best = std::move(intra);
    }
    if (!best) {
      layer_fit.lost.push_back(r);
      continue;
    }
    layer_fit.error = std::max(layer_fit.error, best->error);
    layer_fit.plans.push_back(std::move(best->plan));
    layer_fit.rings.push_back(std::move(best->ring));
  }
  return layer_fit;
}

std::vector<std::vector<GridPoint>> canonical_rings(std::vector<std::vector<GridPoint>> rings) {
  const auto lower = [](GridPoint a, GridPoint b) { return a.y != b.y ? a.y < b.y : a.x < b.x; };
  for (auto& ring : rings) std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end(), lower), ring.end());
  std::sort(rings.begin(), rings.end(), [&](const auto& a, const auto& b) {
    if (!(a[0] == b[0])) return lower(a[0], b[0]);
    const double area_a = twice_area(std::span<const GridPoint>{a});
    const double area_b = twice_area(std::span<const GridPoint>{b});
    if (area_a != area_b) return area_a < area_b;
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end(), lower);
  });
  return rings;
}

std::vector<std::vector<GridPoint>> positions_of(const std::vector<MovingRing>& rings) {
  std::vector<std::vector<GridPoint>> positions;
  positions.reserve(rings.size());
  for (const MovingRing& ring : rings) {
    auto& made = positions.emplace_back();
    made.reserve(ring.size());
    for (const MovingVertex& v : ring) made.push_back(v.at);
  }
  return positions;
}

}  // namespace telefab::codec
