// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/base/key_table.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/contour/grid_tracer.hpp>
#include <telefab/scan/contour/layer_checks.hpp>
#include <tuple>

#include "rings.hpp"

namespace telefab::scan {
namespace {

constexpr std::uint32_t kNone = KeyTable::kNone;
constexpr double kLeastAcross = 0.3;   // in-plane part of a normal; flatter samples do not say where the section passes
constexpr double kSeedRowKernels = 2;  // seeds are tried in rows so wide
/// Cells and nodes are numbered from the middle of this range, so that indices stay positive.
constexpr std::int64_t kHalf = std::int64_t{1} << 30;

struct Node {
  std::int64_t i, j;
};
std::uint64_t key_of(Node n) {
  return static_cast<std::uint64_t>(n.i + kHalf) << 32U | static_cast<std::uint64_t>(n.j + kHalf);
}

class GridTracer {
 public:
  GridTracer(PlaneCursor& plane, Point2 origin, double pitch_mm, const GridOptions& options)
      : plane_{plane}, origin_{origin}, pitch_mm_{pitch_mm}, tolerance_mm_{0.01 * options.chord_mm} {}

  void seed(Point2 p) {
    const Node cell{static_cast<std::int64_t>(std::floor((p.x_mm - origin_.x_mm) / pitch_mm_)),
                    static_cast<std::int64_t>(std::floor((p.y_mm - origin_.y_mm) / pitch_mm_))};
    if (visit(cell)) return;
    for (int dj = -1; dj <= 1; ++dj)
      for (int di = -1; di <= 1; ++di) visit({cell.i + di, cell.j + dj});
  }

  /// Follows sign changes from cell to cell until none is left.
  Result<void> grow(std::stop_token stop) {
    for (std::size_t done = 0; done < crossing_.size(); ++done) {
      if ((done & 63U) == 0 && stop.stop_requested()) return cancelled("tracing");
      if (crossing_.size() > kMaxVerticesPerLayer)
        return fail(ErrorCode::TooLarge, "a layer needs more grid cells than a layer may have vertices");
      const Node cell = crossing_[done];
      const auto corner = corners(cell);
      static constexpr std::array<Node, 4> across{{{0, -1}, {1, 0}, {0, 1}, {-1, 0}}};
      for (int e = 0; e < 4; ++e)
        if (changes(corner[e], corner[(e + 1) % 4])) visit({cell.i + across[e].i, cell.j + across[e].j});
    }
    return {};
  }

  /// Rings along the crossings. A contour that does not close is left out, and its gap listed.
  std::vector<std::vector<PlaneSample>> link(std::vector<ContourGap>& gaps) {
    for (const Node cell : crossing_) link_cell(cell);
    list_gaps(gaps);
    std::vector<std::vector<PlaneSample>> rings;
    std::vector<bool> used(vertices_.size(), false);
    for (std::uint32_t end = 0; end < vertices_.size(); ++end)
      if (next_[end] == kNone)
        for (std::uint32_t v = end; v != kNone; v = previous_[v]) used[v] = true;
    for (std::uint32_t first = 0; first < vertices_.size(); ++first) {
      if (used[first]) continue;
      std::vector<PlaneSample> ring;
      for (std::uint32_t v = first; !used[v]; v = next_[v]) {
        used[v] = true;
        ring.push_back(vertices_[v]);
      }
      rings.push_back(std::move(ring));
    }
    return rings;
  }

 private:
  std::array<Node, 4> corners(Node c) const { return {{c, {c.i + 1, c.j}, {c.i + 1, c.j + 1}, {c.i, c.j + 1}}}; }
  Point2 place(Node n) const {
    return {origin_.x_mm + static_cast<double>(n.i) * pitch_mm_, origin_.y_mm + static_cast<double>(n.j) * pitch_mm_};
  }
  const PlaneSample& node(Node n) {
    const auto [index, fresh] = node_numbers_.number(key_of(n));
    if (fresh) nodes_.push_back(plane_.at(place(n)));
    return nodes_[index];
  }
  bool changes(Node a, Node b) {
    const PlaneSample sa = node(a);
    const PlaneSample sb = node(b);
    return sa.in_reach && sb.in_reach && (sa.value_mm < 0) != (sb.value_mm < 0);
  }
  /// True if the contour passes the cell. A cell is looked at once.
  bool visit(Node cell) {
    const auto [index, fresh] = cell_numbers_.number(key_of(cell));
    if (!fresh) return cell_crosses_[index];
    const auto corner = corners(cell);
    bool crosses = false;
    for (int e = 0; e < 4 && !crosses; ++e) crosses = changes(corner[e], corner[(e + 1) % 4]);
    cell_crosses_.push_back(crosses);
    if (crosses) crossing_.push_back(cell);
    return crosses;
  }
  /// The vertex on the edge between two nodes of unlike sign: a bracketed secant (Illinois) down to the tolerance.
  std::uint32_t vertex(Node a, Node b) {
    if (b.i < a.i || b.j < a.j) std::swap(a, b);
    const std::uint64_t key = key_of({2 * a.i + (b.j > a.j ? 1 : 0), a.j});
    const auto [index, fresh] = edge_numbers_.number(key);
    if (!fresh) return index;
    const PlaneSample sa = node(a);
    const PlaneSample sb = node(b);
    double ta = 0, tb = 1, va = sa.value_mm, vb = sb.value_mm;
    PlaneSample best = sa;
    int side = 0;
    for (int i = 0; i < 40; ++i) {
      const double t = std::clamp(ta - va * (tb - ta) / (vb - va), ta + 1e-3 * (tb - ta), tb - 1e-3 * (tb - ta));
      best = plane_.at({sa.at.x_mm + t * (sb.at.x_mm - sa.at.x_mm), sa.at.y_mm + t * (sb.at.y_mm - sa.at.y_mm)});
      const double v = best.value_mm;
      if (std::abs(v) <= tolerance_mm_ * std::clamp(best.steep, 0.05, 1.0) || tb - ta < 1e-9) break;
      if ((v < 0) == (va < 0)) {
        ta = t, va = v;
        if (side == -1) vb /= 2;
        side = -1;
      } else {
        tb = t, vb = v;
        if (side == 1) va /= 2;
        side = 1;
      }
    }
    vertices_.push_back(best);
    next_.push_back(kNone);
    previous_.push_back(kNone);
    return index;
  }
  void join(std::uint32_t from, std::uint32_t to) {
    next_[from] = to;
    previous_[to] = from;
  }
  /// Segments run with the solid on their left: from an edge that leaves the solid (walking the cell's corners
  /// counter-clockwise) to one that enters it.
  void link_cell(Node cell) {
    const auto corner = corners(cell);
    std::array<int, 4> leaving{}, entering{};
    int leave = 0, enter = 0;
    for (int e = 0; e < 4; ++e)
      if (changes(corner[e], corner[(e + 1) % 4])) {
        if (node(corner[e]).value_mm < 0)
          leaving[leave++] = e;
        else
          entering[enter++] = e;
      }
    const auto on = [&](int e) { return vertex(corner[e], corner[(e + 1) % 4]); };
    if (leave == 1 && enter == 1) {
      join(on(leaving[0]), on(entering[0]));
      return;
    }
    if (leave != 2 || enter != 2) {
      for (int k = 0; k < leave; ++k) (void)on(leaving[k]);
      for (int k = 0; k < enter; ++k) (void)on(entering[k]);
      return;
    }
    // Two ways to link four crossings: the field in the middle says which corners belong together.
    const Point2 low = place(cell);
    const bool solid = plane_.at({low.x_mm + pitch_mm_ / 2, low.y_mm + pitch_mm_ / 2}).value_mm < 0;
    for (int k = 0; k < 2; ++k) {
      const int e = leaving[k];
      join(on(e), on((e + (solid ? 1 : 3)) % 4));
    }
  }
  /// Ends of open contours, each with its distance to the nearest beginning of one.
  void list_gaps(std::vector<ContourGap>& gaps) const {
    std::vector<std::uint32_t> ends, starts;
    for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
      if (next_[v] == kNone && previous_[v] != kNone) ends.push_back(v);
      if (previous_[v] == kNone && next_[v] != kNone) starts.push_back(v);
    }
    for (const std::uint32_t e : ends) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const std::uint32_t s : starts) nearest = std::min(nearest, distance_mm(vertices_[e].at, vertices_[s].at));
      gaps.push_back({vertices_[e].at, nearest, false});
    }
  }

  PlaneCursor& plane_;
  Point2 origin_;
  double pitch_mm_;
  double tolerance_mm_;
  KeyTable node_numbers_, cell_numbers_, edge_numbers_;
  std::vector<PlaneSample> nodes_;
  std::vector<bool> cell_crosses_;
  std::vector<Node> crossing_;
  std::vector<PlaneSample> vertices_;
  std::vector<std::uint32_t> next_, previous_;
};

Doubt doubt_of(const ContourGap& gap) {
  // Where no other end is left to be joined, the size is unknown.
  return {.reason = DoubtReason::ContoursLeftOut,
          .place = gap.place,
          .size_mm = std::isfinite(gap.size_mm) ? gap.size_mm : 0};
}

}  // namespace

Result<LayerTrace> trace_by_grid(const ScalarField& field, FieldCursor& cursor, double z_mm, const SampleView& near,
                                 const GridOptions& options, std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  LayerTrace trace;
  if (near.points.empty()) return trace;
  // The narrowest kernel of the layer decides, within reason.
  std::vector<double> widths;
  widths.reserve(near.points.size());
  for (const Vec3& p : near.points) widths.push_back(field.kernel_width_mm(p));
  std::nth_element(widths.begin(), widths.begin() + widths.size() / 20, widths.end());
  const double width = widths[widths.size() / 20];
  const Box3 box = field.bounds();

  PlaneCursor plane{cursor, z_mm};
  GridTracer tracer{plane, {box.min.x(), box.min.y()}, options.pitch_kernels * width, options};
  std::vector<Vec2> seeds;
  seeds.reserve(near.points.size());
  for (std::size_t i = 0; i < near.points.size(); ++i) {
    const Vec3& p = near.points[i];
    seeds.push_back(first_order_crossing(p, near.normals[i], z_mm, 2 * width, kLeastAcross).value_or(p.head<2>()));
  }
  // In rows of neighbours, which the cursor has gathered together; the order of the samples is that of their heights.
  const double row_mm = kSeedRowKernels * width;
  std::sort(seeds.begin(), seeds.end(), [&](const Vec2& a, const Vec2& b) {
    const auto row = [&](const Vec2& p) { return std::floor(p.y() / row_mm); };
    return std::tuple(row(a), a.x(), a.y()) < std::tuple(row(b), b.x(), b.y());
  });
  for (const Vec2& p : seeds) tracer.seed({p.x(), p.y()});
  if (auto ok = tracer.grow(stop); !ok) return tl::unexpected{ok.error()};
  auto rings = tracer.link(trace.gaps);
  for (const ContourGap& gap : trace.gaps) trace.faults.push_back(doubt_of(gap));
  for (auto& ring : rings) {
    if (stop.stop_requested()) return cancelled("tracing");
    refine(ring, plane, options.chord_mm);
    keep_ring(ring, field, z_mm, trace.contours);
  }
  trace.evaluations = plane.evaluations();
  finish_trace(trace);
  return trace;
}

}  // namespace telefab::scan
