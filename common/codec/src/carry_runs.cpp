// SPDX-License-Identifier: GPL-3.0-or-later
#include "carry_runs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "layer_coding.hpp"

namespace telefab::codec {
namespace {

constexpr int kCells = 128;  ///< along the longer side

/// All edges of some rings, found by place.
class EdgeMap {
 public:
  struct Edge {
    Point2 a, b;
    std::size_t ring = 0;
    std::size_t number = 0;
  };

  explicit EdgeMap(std::span<const Contour> rings) {
    Bounds2 box = rings[0].bounds();
    for (const Contour& ring : rings) box.include(ring.bounds());
    low_ = box.min;
    cell_mm_ = std::max(box.width_mm(), box.depth_mm()) / kCells;
    for (std::size_t r = 0; r < rings.size(); ++r) {
      const auto v = rings[r].vertices();
      for (std::size_t i = 0; i < v.size(); ++i) edges_.push_back({v[i], v[(i + 1) % v.size()], r, i});
    }
    // Edges of a cell behind each other, in the order of their numbers: counted, then put.
    first_.assign(static_cast<std::size_t>(kCells) * kCells + 1, 0);
    for (const Edge& edge : edges_) each_cell(edge, [&](std::size_t cell) { ++first_[cell + 1]; });
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    in_cells_.resize(first_.back());
    std::vector<std::uint32_t> next{first_.begin(), first_.end() - 1};
    for (std::uint32_t e = 0; e < edges_.size(); ++e)
      each_cell(edges_[e], [&](std::size_t cell) { in_cells_[next[cell]++] = e; });
  }
  [[nodiscard]] const std::vector<Edge>& edges() const { return edges_; }

  /// The edge nearest to p; the lower number of two as near.
  [[nodiscard]] const Edge& nearest(Point2 p) const {
    const std::array<int, 2> middle = cell_of(p);
    std::uint32_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (int reach = 0; reach < kCells; ++reach) {
      // Cells this far out are at least so far away.
      if ((reach - 1) * cell_mm_ > std::sqrt(least)) break;
      for (int y = middle[1] - reach; y <= middle[1] + reach; ++y)
        for (int x = middle[0] - reach; x <= middle[0] + reach; ++x) {
          if (std::max(std::abs(x - middle[0]), std::abs(y - middle[1])) != reach) continue;
          if (x < 0 || y < 0 || x >= kCells || y >= kCells) continue;
          const std::size_t cell = static_cast<std::size_t>(y) * kCells + static_cast<std::size_t>(x);
          for (std::uint32_t k = first_[cell]; k < first_[cell + 1]; ++k) {
            const std::uint32_t e = in_cells_[k];
            if (const double d2 = distance2(edges_[e], p); d2 < least || (d2 == least && e < best)) {
              least = d2;
              best = e;
            }
          }
        }
    }
    return edges_[best];
  }

 private:
  [[nodiscard]] std::array<int, 2> cell_of(Point2 p) const {
    const auto index = [&](double offset) {
      return static_cast<int>(std::clamp(std::floor(offset / cell_mm_), 0.0, kCells - 1.0));
    };
    return {index(p.x_mm - low_.x_mm), index(p.y_mm - low_.y_mm)};
  }
  /// Those that its box touches.
  template <class Each>
  void each_cell(const Edge& edge, Each&& each) const {
    const auto a = cell_of({std::min(edge.a.x_mm, edge.b.x_mm), std::min(edge.a.y_mm, edge.b.y_mm)});
    const auto b = cell_of({std::max(edge.a.x_mm, edge.b.x_mm), std::max(edge.a.y_mm, edge.b.y_mm)});
    for (int y = a[1]; y <= b[1]; ++y)
      for (int x = a[0]; x <= b[0]; ++x) each(static_cast<std::size_t>(y) * kCells + static_cast<std::size_t>(x));
  }
  static double distance2(const Edge& e, Point2 p) {
    const double dx = e.b.x_mm - e.a.x_mm;
    const double dy = e.b.y_mm - e.a.y_mm;
    const double t = std::clamp(((p.x_mm - e.a.x_mm) * dx + (p.y_mm - e.a.y_mm) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
    const double x = e.a.x_mm + t * dx - p.x_mm;
    const double y = e.a.y_mm + t * dy - p.y_mm;
    return x * x + y * y;
  }

  Point2 low_;
  double cell_mm_ = 1;
  std::vector<Edge> edges_;
  std::vector<std::uint32_t> first_;     ///< place of a cell's edges; one more than there are cells
  std::vector<std::uint32_t> in_cells_;  ///< edges
};

Point2 middle_of(const EdgeMap::Edge& e) { return {(e.a.x_mm + e.b.x_mm) / 2, (e.a.y_mm + e.b.y_mm) / 2}; }

void take_graver(SurfaceRun& into, const SurfaceRun& from) {
  into.kind = std::max(into.kind, from.kind);
  into.gap_mm = std::max(into.gap_mm, from.gap_mm);
  into.error_mm = std::max(into.error_mm, from.error_mm);
}

}  // namespace

Result<std::vector<Contour>> carry_runs(std::span<const Contour> given, std::vector<Contour> coded) {
  const bool some = std::any_of(given.begin(), given.end(), [](const Contour& c) { return !c.runs().empty(); });
  if (!some || coded.empty()) return coded;
  const EdgeMap from{given};
  const EdgeMap to{coded};
  std::vector<std::vector<SurfaceRun>> of_given, of_coded;
  for (const Contour& ring : given) of_given.push_back(one_an_edge(ring.runs(), ring.vertices().size()));
  for (const Contour& ring : coded) of_coded.emplace_back(ring.vertices().size());
  for (const EdgeMap::Edge& e : to.edges()) {
    const EdgeMap::Edge& beside = from.nearest(middle_of(e));
    take_graver(of_coded[e.ring][e.number], of_given[beside.ring][beside.number]);
  }
  for (const EdgeMap::Edge& e : from.edges()) {
    const SurfaceRun& run = of_given[e.ring][e.number];
    if (run.kind == SurfaceClass::Measured) continue;
    const EdgeMap::Edge& beside = to.nearest(middle_of(e));
    take_graver(of_coded[beside.ring][beside.number], run);
  }
  for (std::size_t r = 0; r < coded.size(); ++r) {
    for (SurfaceRun& run : of_coded[r]) run = as_coded(run);
    auto with_runs_made = coded[r].with_runs(of_coded[r]);
    if (!with_runs_made) return tl::unexpected{with_runs_made.error()};
    coded[r] = std::move(*with_runs_made);
  }
  return coded;
}

}  // namespace telefab::codec
