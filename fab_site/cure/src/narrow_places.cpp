// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/fab/cure/narrow_places.hpp>

namespace telefab::fab {
namespace {

constexpr double kFacing = 0.7;        // cosine between the way across and the normal of the other side, at least
constexpr double kCornerWidths = 1.5;  // along a ring, edges nearer than this belong to one corner
constexpr double kSpeckWidths = 3;
constexpr double kTouching = 1e-6;  // of the reach; the edge a point lies on is not met
constexpr std::size_t kMostCells = std::size_t{1} << 18U;

struct Edge {
  Point2 a, b;
  Point2 inward;     // unit normal, into the material
  double start = 0;  // way along the ring to a
  std::uint32_t ring = 0;
};

/// The edges of a layer by square cells.
class EdgeGrid {
 public:
  EdgeGrid(std::span<const Edge> edges, double cell_mm) : edges_{edges}, cell_{cell_mm} {
    Bounds2 box = Bounds2::nothing();
    for (const Edge& e : edges)
      for (const Point2 p : {e.a, e.b}) box.include(p);
    low_ = box.min;
    const double width = box.width_mm(), depth = box.depth_mm();
    cell_ = std::max(cell_, std::sqrt(std::max(width, cell_) * std::max(depth, cell_) / kMostCells));
    columns_ = static_cast<int>(width / cell_) + 1;
    rows_ = static_cast<int>(depth / cell_) + 1;
    starts_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
    for (const Edge& e : edges) each_cell(e.a, e.b, [&](std::size_t cell) { ++starts_[cell + 1]; });
    for (std::size_t i = 1; i < starts_.size(); ++i) starts_[i] += starts_[i - 1];
    items_.resize(starts_.back());
    std::vector<std::uint32_t> next{starts_.begin(), starts_.end() - 1};
    for (std::uint32_t i = 0; i < edges.size(); ++i)
      each_cell(edges[i].a, edges[i].b, [&](std::size_t cell) { items_[next[cell]++] = i; });
  }

  /// How far it is from a point in a unit direction to the edge that is met first, if that faces the point; else
  /// negative. Edges of which `near` says yes belong to the corner the point lies at: they end the way.
  template <class Near>
  [[nodiscard]] double first_facing(Point2 from, Point2 way, double reach, const Near& near) const {
    double first = reach;
    bool faces = false;
    each_cell(from, {from.x_mm + way.x_mm * reach, from.y_mm + way.y_mm * reach}, [&](std::size_t cell) {
      for (std::uint32_t k = starts_[cell]; k < starts_[cell + 1]; ++k) {
        const Edge& e = edges_[items_[k]];
        const double ex = e.b.x_mm - e.a.x_mm, ey = e.b.y_mm - e.a.y_mm;
        const double across = way.x_mm * ey - way.y_mm * ex;
        if (across == 0) continue;
        const double ax = e.a.x_mm - from.x_mm, ay = e.a.y_mm - from.y_mm;
        const double at = (ax * ey - ay * ex) / across;
        const double along = (ax * way.y_mm - ay * way.x_mm) / across;
        if (!(at > kTouching * reach && at < first && along >= 0 && along <= 1)) continue;
        first = at;
        faces = !near(e, along) && std::abs(e.inward.x_mm * way.x_mm + e.inward.y_mm * way.y_mm) > kFacing;
      }
    });
    return faces ? first : -1;
  }

 private:
  template <class Visit>
  void each_cell(Point2 a, Point2 b, Visit visit) const {
    const auto column = [&](double x) {
      return std::clamp(static_cast<int>((x - low_.x_mm) / cell_), 0, columns_ - 1);
    };
    const auto row = [&](double y) { return std::clamp(static_cast<int>((y - low_.y_mm) / cell_), 0, rows_ - 1); };
    if (a.x_mm > b.x_mm) std::swap(a, b);
    const int last = column(b.x_mm);
    const double rise = b.x_mm > a.x_mm ? (b.y_mm - a.y_mm) / (b.x_mm - a.x_mm) : 0;
    for (int c = column(a.x_mm); c <= last; ++c) {
      // The part of the line within the column, and a hair more for rounding.
      const double from = std::max(a.x_mm, low_.x_mm + c * cell_), to = std::min(b.x_mm, low_.x_mm + (c + 1) * cell_);
      double y0 = a.y_mm, y1 = b.y_mm;
      if (rise != 0) {
        y0 = a.y_mm + (from - a.x_mm) * rise;
        y1 = a.y_mm + (to - a.x_mm) * rise;
      }
      const double hair = 1e-9 * cell_;
      const int high = row(std::max(y0, y1) + hair);
      for (int r = row(std::min(y0, y1) - hair); r <= high; ++r)
        visit(static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(c));
    }
  }

  std::span<const Edge> edges_;
  double cell_;
  Point2 low_;
  int columns_ = 1, rows_ = 1;
  std::vector<std::uint32_t> starts_, items_;
};

NarrowPlace speck(const Contour& ring, double length_mm, double width_mm) {
  const Bounds2 box = ring.bounds();
  return {ring.is_hole() ? NarrowPlace::Kind::Gap : NarrowPlace::Kind::Wall,
          {(box.min.x_mm + box.max.x_mm) / 2, (box.min.y_mm + box.max.y_mm) / 2},
          width_mm,
          length_mm / 2};
}

}  // namespace

std::vector<NarrowPlace> narrow_places(std::span<const Contour> rings, double below_mm, double step_mm) {
  std::vector<Edge> edges;
  std::vector<double> lengths;
  std::vector<std::size_t> ends;
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const auto v = rings[r].vertices();
    double way = 0;
    for (std::size_t i = 0; i < v.size(); ++i) {
      const Point2 a = v[i], b = v[i + 1 == v.size() ? 0 : i + 1];
      const double dx = b.x_mm - a.x_mm, dy = b.y_mm - a.y_mm, length = std::hypot(dx, dy);
      edges.push_back({a, b, {-dy / length, dx / length}, way, r});
      way += length;
    }
    lengths.push_back(way);
    ends.push_back(edges.size());
  }
  std::vector<NarrowPlace> places;
  if (edges.empty()) return places;
  const EdgeGrid grid{edges, below_mm};
  std::size_t first = 0;
  for (std::uint32_t r = 0; r < rings.size(); first = ends[r++]) {
    const double around = lengths[r];
    if (around < kSpeckWidths * below_mm) {
      const double width = 4 * std::abs(rings[r].signed_area_mm2()) / around;
      if (width < below_mm) places.push_back(speck(rings[r], around, width));
      continue;
    }
    const auto samples = std::max(1.0, std::round(around / step_mm));
    const double step = around / samples;
    std::size_t at = first;
    for (double k = 0; k < samples; ++k) {
      const double way = (k + 0.5) * step;
      while (at + 1 < ends[r] && edges[at + 1].start <= way) ++at;
      const Edge& own = edges[at];
      const Point2 along{own.inward.y_mm, -own.inward.x_mm};
      const Point2 from{own.a.x_mm + along.x_mm * (way - own.start), own.a.y_mm + along.y_mm * (way - own.start)};
      const auto near = [&](const Edge& e, double share) {
        if (e.ring != r) return false;
        const double there = e.start + share * std::hypot(e.b.x_mm - e.a.x_mm, e.b.y_mm - e.a.y_mm);
        const double apart = std::abs(there - way);
        return std::min(apart, around - apart) < kCornerWidths * below_mm;
      };
      for (const auto kind : {NarrowPlace::Kind::Wall, NarrowPlace::Kind::Gap}) {
        const double sign = kind == NarrowPlace::Kind::Wall ? 1 : -1;
        const Point2 across{sign * own.inward.x_mm, sign * own.inward.y_mm};
        const double width = grid.first_facing(from, across, below_mm, near);
        if (width <= 0) continue;
        // Both sides of it are looked at from, so each stands for half of its step.
        places.push_back(
            {kind, {from.x_mm + across.x_mm * width / 2, from.y_mm + across.y_mm * width / 2}, width, step / 2});
      }
    }
  }
  return places;
}

}  // namespace telefab::fab
