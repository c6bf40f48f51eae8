// SPDX-License-Identifier: GPL-3.0-or-later
#include "reeb_nodes.hpp"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "plateaus.hpp"

namespace telefab::scan::topology {
namespace {

constexpr double kMarginKernels = 0.02;  // rings are traced this far below and above
constexpr double kPlateauMarginKernels = 0.05;
constexpr double kSameRingKernels = 0.08;
constexpr double kSeedLimitKernels = 0.75;
constexpr double kLeaveKernels = 0.1;  // first step away from a saddle

double height(const CriticalPoint& c) { return c.position_mm.z(); }

/// Runs of critical heights too near to be ordered, each with the levels of its rings.
std::vector<Level> levels_of(const ScalarField& field, std::span<const CriticalPoint> points, double run_kernels,
                             std::vector<std::size_t>& run_of) {
  std::vector<Level> runs;
  std::vector<double> kernels;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double h = field.kernel_width_mm(points[i].position_mm);
    const double z = height(points[i]);
    if (runs.empty() || z - runs.back().high > run_kernels * std::min(h, kernels.back())) {
      runs.push_back({z, z, z, z});
      kernels.push_back(h);
    }
    runs.back().high = z;
    kernels.back() = std::min(h, kernels.back());
    run_of.push_back(runs.size() - 1);
  }
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const double most = kMarginKernels * kernels[r];
    const double gap_below = r > 0 ? runs[r].low - runs[r - 1].high : 1e300;
    const double gap_above = r + 1 < runs.size() ? runs[r + 1].low - runs[r].high : 1e300;
    runs[r].below = runs[r].low - std::min(most, gap_below / 3);
    runs[r].above = runs[r].high + std::min(most, gap_above / 3);
  }
  return runs;
}

/// Two rising and two falling lines of a saddle; of a lone extremum the one that leaves it.
std::vector<IntegralLine> lines_of(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index,
                                   std::size_t i, double margin_mm) {
  const CriticalPoint& c = index[i];
  const double h = field.kernel_width_mm(c.position_mm);
  std::vector<IntegralLine> lines;
  for (const bool ascending : {true, false}) {
    if (c.kind == (ascending ? CriticalKind::Maximum : CriticalKind::Minimum)) continue;
    const int axis = ascending ? 1 : 0;
    const double bend = std::max(std::abs(c.curvature_per_mm[axis]), 1e-9);
    const double leave = std::clamp(std::sqrt(0.6 * margin_mm / bend), 0.005 * h, kLeaveKernels * h);
    for (const double side : {1.0, -1.0}) {
      if (side < 0 && !c.is_saddle()) continue;
      const Vec2 out = side * leave * c.axes.col(axis);
      const Vec3 start = c.position_mm + Vec3{out.x(), out.y(), 0.5 * c.curvature_per_mm[axis] * leave * leave};
      SteepestLine steepest = follow_steepest(field, cursor, index, start, ascending, i);
      IntegralLine line{i, steepest.end, ascending, {c.position_mm}};
      for (const Vec3& p : steepest.path_mm)
        if (ascending ? p.z() > line.path_mm.back().z() : p.z() < line.path_mm.back().z()) line.path_mm.push_back(p);
      lines.push_back(std::move(line));
    }
  }
  return lines;
}

int signed_count(const std::vector<Ring>& rings) {
  int count = 0;
  for (const Ring& r : rings) count += r.is_hole() ? -1 : 1;
  return count;
}

bool shares_ring(const std::vector<Ring>& a, const std::vector<Ring>& b, double same_mm) {
  for (const Ring& r : a)
    for (const Ring& s : b)
      if (r.distance_mm(s.points.front(), same_mm) < same_mm) return true;
  return false;
}

/// Nearest seeds of a saddle's two branches decide how near "the same ring" may be.
double same_ring_mm(const std::vector<Vec3>& seeds, double h) {
  double same = kSameRingKernels * h;
  if (seeds.size() == 2) same = std::min(same, 0.25 * (seeds[0] - seeds[1]).norm());
  return same;
}

Around look_around(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index, std::size_t i,
                   const Level& level, const std::stop_token& stop) {
  Around a;
  a.level = level;
  a.lines = lines_of(field, cursor, index, i,
                     std::min(index[i].position_mm.z() - level.below, level.above - index[i].position_mm.z()));
  const double h = field.kernel_width_mm(index[i].position_mm);
  std::vector<Vec3> seeds_below, seeds_above;
  for (const IntegralLine& line : a.lines) {
    const double z = line.ascending ? level.above : level.below;
    if (const auto p = point_at_height(line.path_mm, z)) (line.ascending ? seeds_above : seeds_below).push_back(*p);
  }
  const auto rings_at = [&](double z, const std::vector<Vec3>& seeds) {
    std::vector<Ring> open;
    return distinct_rings(field, cursor, seeds, z, same_ring_mm(seeds, h), 0.3, open, stop);
  };
  a.below = rings_at(level.below, seeds_below);
  a.above = rings_at(level.above, seeds_above);
  return a;
}

/// The same for a point alone at its height: where rings do not fit its kind at one distance, others are tried.
Around look_around_alone(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index, std::size_t i,
                         const Level& level, const std::stop_token& stop) {
  const std::size_t wanted = index[i].is_saddle() ? 3 : 1;
  Around first;
  for (const double share : {1.0, 0.3, 0.1, 1.4}) {
    const Level nearer{level.low, level.high, level.low - share * (level.low - level.below),
                       level.high + share * (level.above - level.high)};
    Around a = look_around(field, cursor, index, i, nearer, stop);
    if (a.below.size() + a.above.size() == wanted) return a;
    if (share == 1.0) first = std::move(a);
  }
  return first;
}

int sign_of(const CriticalPoint& c) { return c.is_saddle() ? -1 : 1; }

void judge(NodeRings& n) {
  const int b = static_cast<int>(n.below.size() + n.above.size());
  const int step = signed_count(n.above) - signed_count(n.below);
  if (n.euler != 2 - b)
    n.inconsistency = fmt::format("{} rings below and {} above do not fit its kind", n.below.size(), n.above.size());
  else if (n.euler_step != step)
    n.inconsistency = fmt::format("rings change the Euler number by {}, its kind says {}", step, n.euler_step);
  n.node.resolved = n.inconsistency.empty();
}

NodeRings plateau_node(const ScalarField& field, FieldCursor& cursor, std::span<const Vec3> samples,
                       std::span<const Vec3> normals, std::span<const CriticalPoint> points, const CriticalIndex& index,
                       const Plateau& plateau, std::size_t number, const std::stop_token& stop) {
  NodeRings n;
  n.node.plateau = number;
  n.node.place_mm = plateau.place_mm;
  n.node.low_mm = plateau.low_mm;
  n.node.high_mm = plateau.high_mm;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i].plateau == number) n.node.critical_points.push_back(i);
  const double h = field.kernel_width_mm(plateau.place_mm);
  double margin_below = kPlateauMarginKernels * h;
  double margin_above = kPlateauMarginKernels * h;
  for (const CriticalPoint& c : points) {
    if (height(c) < plateau.low_mm) margin_below = std::min(margin_below, (plateau.low_mm - height(c)) / 3);
    if (height(c) > plateau.high_mm) margin_above = std::min(margin_above, (height(c) - plateau.high_mm) / 3);
  }
  n.level_below_mm = plateau.low_mm - std::max(margin_below, 0.003 * h);
  n.level_above_mm = plateau.high_mm + std::max(margin_above, 0.003 * h);
  // Steepest lines from points between the levels stay on the piece of surface until they leave it at a level.
  std::vector<Vec3> starts = points_around(field, cursor, samples, normals, points, n.node.critical_points,
                                           n.level_below_mm, n.level_above_mm);
  for (const std::size_t c : n.node.critical_points) starts.push_back(points[c].position_mm);
  for (const bool ascending : {false, true}) {
    const double level = ascending ? n.level_above_mm : n.level_below_mm;
    std::vector<Ring>& rings = ascending ? n.above : n.below;
    std::vector<Ring> open;
    for (const Vec3& start : starts) {
      if (stop.stop_requested()) return n;
      const SteepestLine line = follow_steepest(field, cursor, index, start, ascending, {}, level);
      const auto seed = point_at_height(line.path_mm, level);
      if (!seed) continue;
      const double same = kSameRingKernels * h;
      if (std::any_of(rings.begin(), rings.end(),
                      [&](const Ring& r) { return r.distance_mm(seed->head<2>(), same) < same; }))
        continue;
      const Vec3 seeds[] = {*seed};
      for (Ring& ring : distinct_rings(field, cursor, seeds, level, same, kSeedLimitKernels, open, stop))
        if (!shares_ring({ring}, rings, same)) rings.push_back(std::move(ring));
    }
  }
  n.line_above.assign(n.above.size(), std::nullopt);
  n.euler = 2 - static_cast<int>(n.below.size() + n.above.size());
  n.euler_step = signed_count(n.above) - signed_count(n.below);
  // Where its critical points are sound and account for the rings, they also tell of handles inside.
  int signs = 0;
  int steps = 0;
  bool sound = true;
  for (const std::size_t i : n.node.critical_points) {
    signs += sign_of(points[i]);
    steps += points[i].euler_step();
    sound = sound && !points[i].degenerate;
  }
  if (sound && steps == n.euler_step && signs <= n.euler && (signs - n.euler) % 2 == 0) n.euler = signs;
  if (n.below.empty() && n.above.empty()) {
    n.inconsistency = "no ring leaves it";
    n.node.resolved = false;
  }
  return n;
}

}  // namespace

std::optional<Vec3> point_at_height(std::span<const Vec3> path, double z_mm) {
  if (path.size() < 2) return std::nullopt;
  const bool rising = path.back().z() > path.front().z();
  const auto before = [&](const Vec3& p, double z) { return rising ? p.z() < z : p.z() > z; };
  const auto at = std::lower_bound(path.begin(), path.end(), z_mm, before);
  if (at == path.end()) return std::nullopt;
  if (at == path.begin()) return at->z() == z_mm ? std::optional<Vec3>{*at} : std::nullopt;
  const Vec3& a = *(at - 1);
  const double share = (z_mm - a.z()) / (at->z() - a.z());
  Vec3 p = a + share * (*at - a);
  p.z() = z_mm;
  return p;
}

Result<TracedNodes> trace_nodes(const ScalarField& field, std::span<const Vec3> samples, std::span<const Vec3> normals,
                                std::span<const CriticalPoint> points, std::span<const Plateau> plateaus,
                                const CriticalIndex& index, double run_kernels, NodeMemory& memory,
                                std::stop_token stop) {
  std::vector<std::size_t> run_of;
  const std::vector<Level> runs = levels_of(field, points, run_kernels, run_of);
  memory.alone.resize(points.size());
  memory.in_run.resize(points.size());
  memory.flat.resize(plateaus.size());
  std::vector<Around> arounds(points.size());
  std::vector<NodeRings> flat(plateaus.size());
  tbb::enumerable_thread_specific<std::unique_ptr<FieldCursor>> cursors([&] { return field.cursor(); });
  std::vector<std::size_t> run_size(runs.size(), 0);
  for (const std::size_t r : run_of) ++run_size[r];
  tbb::parallel_for(std::size_t{0}, points.size() + plateaus.size(), [&](std::size_t k) {
    if (stop.stop_requested()) return;
    FieldCursor& cursor = *cursors.local();
    if (k >= points.size()) {
      const std::size_t p = k - points.size();
      if (!memory.flat[p])
        memory.flat[p] = plateau_node(field, cursor, samples, normals, points, index, plateaus[p], p, stop);
      flat[p] = *memory.flat[p];
    } else if (!points[k].plateau) {
      const std::size_t run = run_of[k];
      const bool is_alone = run_size[run] == 1;
      auto& known = (is_alone ? memory.alone : memory.in_run)[k];
      if (!known || known->asked != runs[run])
        known = {runs[run], is_alone ? look_around_alone(field, cursor, index, k, runs[run], stop)
                                     : look_around(field, cursor, index, k, runs[run], stop)};
      arounds[k] = known->seen;
    }
  });
  if (stop.stop_requested()) return cancelled("tracing the Morse-Smale complex");

  // Critical points of one run that share a ring are one node.
  TracedNodes traced;
  std::vector<std::vector<std::size_t>> first_line(points.size());
  for (std::size_t begin = 0; begin < points.size();) {
    std::size_t end = begin;
    while (end < points.size() && run_of[end] == run_of[begin]) ++end;
    const Level& level = end - begin == 1 && !points[begin].plateau ? arounds[begin].level : runs[run_of[begin]];
    std::vector<std::size_t> owner(end - begin);
    for (std::size_t i = begin; i < end; ++i) {
      owner[i - begin] = i;
      const double same = 0.5 * kSameRingKernels * field.kernel_width_mm(points[i].position_mm);
      for (std::size_t j = begin; j < i; ++j)
        if (shares_ring(arounds[i].below, arounds[j].below, same) ||
            shares_ring(arounds[i].above, arounds[j].above, same)) {
          const std::size_t from = std::max(owner[i - begin], owner[j - begin]);
          const std::size_t to = std::min(owner[i - begin], owner[j - begin]);
          std::replace(owner.begin(), owner.end(), from, to);
        }
    }
    for (std::size_t root = begin; root < end; ++root) {
      if (owner[root - begin] != root || points[root].plateau) continue;
      NodeRings n;
      n.level_below_mm = level.below;
      n.level_above_mm = level.above;
      n.node.place_mm = points[root].position_mm;
      n.node.low_mm = n.node.high_mm = height(points[root]);
      for (std::size_t i = root; i < end; ++i) {
        if (owner[i - begin] != root) continue;
        n.node.critical_points.push_back(i);
        n.node.high_mm = height(points[i]);
        n.euler += sign_of(points[i]);
        n.euler_step += points[i].euler_step();
        const double same = 0.5 * kSameRingKernels * field.kernel_width_mm(points[i].position_mm);
        for (Ring& ring : arounds[i].below)
          if (!shares_ring({ring}, n.below, same)) n.below.push_back(std::move(ring));
        for (Ring& ring : arounds[i].above)
          if (!shares_ring({ring}, n.above, same)) n.above.push_back(std::move(ring));
      }
      n.line_above.assign(n.above.size(), std::nullopt);
      for (const std::size_t i : n.node.critical_points) {
        for (IntegralLine& line : arounds[i].lines) {
          const double h = field.kernel_width_mm(points[i].position_mm);
          if (line.ascending)
            if (const auto p = point_at_height(line.path_mm, level.above))
              for (std::size_t r = 0; r < n.above.size(); ++r)
                if (!n.line_above[r] &&
                    n.above[r].distance_mm(p->head<2>(), kSameRingKernels * h) < kSameRingKernels * h)
                  n.line_above[r] = traced.lines.size();
          traced.lines.push_back(std::move(line));
        }
      }
      judge(n);
      traced.nodes.push_back(std::move(n));
    }
    begin = end;
  }
  for (NodeRings& n : flat) traced.nodes.push_back(std::move(n));
  std::stable_sort(traced.nodes.begin(), traced.nodes.end(),
                   [](const NodeRings& a, const NodeRings& b) { return a.level_below_mm < b.level_below_mm; });
  return traced;
}

}  // namespace telefab::scan::topology
