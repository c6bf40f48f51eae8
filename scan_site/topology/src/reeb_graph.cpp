// SPDX-License-Identifier: GPL-3.0-or-later
#include "reeb_graph.hpp"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <numeric>
#include <telefab/base/disjoint_sets.hpp>

#include "contour_way.hpp"

namespace telefab::scan::topology {
namespace {

constexpr double kOnRingKernels = 0.1;
/// A height that nobody saw is looked for to within so many kernels.
constexpr double kUnseenKernels = 0.05;

/// Where the contour that begins at a ring above a node first meets another node.
struct Meeting {
  std::optional<std::size_t> node;
  std::optional<std::size_t> ring;  ///< index among node's rings below; none: reached without a ring
  std::vector<Vec3> path;
  std::vector<Vec3> losses;  ///< where its curve was lost and found elsewhere
};

std::string place_text(const Vec3& p) { return fmt::format("({:.3f}, {:.3f}, {:.3f})", p.x(), p.y(), p.z()); }

struct NodeRing {
  std::size_t node, ring;
  Vec3 place;
};

/// The first ring below a node that the path comes by above `from_mm`.
std::optional<NodeRing> first_ring_met(const ScalarField& field, const TracedNodes& traced, std::span<const Vec3> path,
                                       double from_mm) {
  // Nodes are sorted by the level below them.
  auto at = std::upper_bound(traced.nodes.begin(), traced.nodes.end(), from_mm,
                             [](double z, const NodeRings& other) { return z < other.level_below_mm; });
  for (; at != traced.nodes.end() && at->level_below_mm <= path.back().z(); ++at) {
    const auto p = point_at_height(path, at->level_below_mm);
    if (!p) continue;
    std::optional<std::size_t> ring;
    double nearest = kOnRingKernels * field.kernel_width_mm(*p);
    const double reach = nearest;
    for (std::size_t r = 0; r < at->below.size(); ++r) {
      const double d = at->below[r].distance_mm(p->head<2>(), reach);
      if (d < nearest) {
        nearest = d;
        ring = r;
      }
    }
    if (ring) return NodeRing{static_cast<std::size_t>(at - traced.nodes.begin()), *ring, *p};
  }
  return std::nullopt;
}

Meeting follow_up(const ScalarField& field, FieldCursor& cursor, const TracedNodes& traced, const CriticalIndex& index,
                  std::span<const std::size_t> node_of, std::size_t from, std::size_t port,
                  const std::stop_token& stop) {
  const NodeRings& n = traced.nodes[from];
  const auto first_line = [&]() -> SteepestLine {
    if (const auto known = n.line_above[port]) return {traced.lines[*known].path_mm, traced.lines[*known].end};
    const Ring& ring = n.above[port];
    return follow_steepest(field, cursor, index, {ring.points.front().x(), ring.points.front().y(), ring.z_mm}, true,
                           {});
  };
  ContourWay way{first_line()};
  Meeting meeting;
  if (way.path_mm.empty()) return meeting;
  // A line that got stuck beside the point it comes from has not arrived.
  const auto lose_own_end = [&] {
    if (way.end && node_of[*way.end] == from) way.end.reset();
  };
  lose_own_end();
  std::optional<NodeRing> met = first_ring_met(field, traced, way.path_mm, n.level_above_mm);
  while (!met && go_on_elsewhere(field, cursor, index, true, way, stop)) {
    lose_own_end();
    met = first_ring_met(field, traced, way.path_mm, n.level_above_mm);
  }
  meeting.losses = std::move(way.losses_mm);
  meeting.path = std::move(way.path_mm);
  if (met) {
    meeting.node = met->node;
    meeting.ring = met->ring;
    // The arc ends where the node begins.
    const double z_end = std::max(traced.nodes[met->node].node.low_mm, met->place.z());
    const auto last = point_at_height(meeting.path, z_end);
    std::erase_if(meeting.path, [&](const Vec3& q) { return q.z() >= z_end; });
    if (last) meeting.path.push_back(*last);
  } else if (way.end) {
    meeting.node = node_of[*way.end];
  }
  return meeting;
}

/// Arcs that arrive at one ring below a node: one, or the graph misses something.
struct Arrivals {
  std::size_t node = 0;
  std::size_t ring = 0;
  std::vector<std::size_t> arcs;
};

/// Where the graph misses a critical point.
struct Unseen {
  HeightRange at;
  bool hides = false;  ///< what the graph tells of the heights above it, up to the ring, is not to be relied on
};

/// Finds between which heights the graph misses a critical point.
class UnseenHeights {
 public:
  UnseenHeights(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index,
                const HeightTopology::Parts& parts, std::span<const NodeRings> built,
                std::span<const std::size_t> node_of, const std::stop_token& stop)
      : field_{field}, cursor_{cursor}, index_{index}, parts_{parts}, built_{built}, node_of_{node_of}, stop_{stop} {}

  [[nodiscard]] Unseen below(const Arrivals& at) const {
    if (at.arcs.empty()) return began(at);
    return {about(became_one(at), at), true};
  }

 private:
  /// None arrives. On the way down from the ring its contour meets one that an arc follows: above, that arc went
  /// elsewhere and this contour began. Or the way ends at a node whose rings were lost: there it began.
  [[nodiscard]] Unseen began(const Arrivals& at) const {
    const NodeRings& node = built_[at.node];
    const Ring& ring = node.below[at.ring];
    const Vec2& p = ring.points.front();
    ContourWay down{follow_steepest(field_, cursor_, index_, {p.x(), p.y(), ring.z_mm}, false, {})};
    while (go_on_elsewhere(field_, cursor_, index_, false, down, stop_)) {
    }
    if (down.path_mm.empty()) return {{node.node.low_mm, node.node.low_mm}};
    if (down.end)
      if (const ReebNode& first = parts_.nodes[node_of_[*down.end]]; !first.resolved && first.arcs_above.empty())
        return {{first.low_mm, first.high_mm}};
    const auto is_followed = [&](double z_mm) {
      const auto on = point_at_height(down.path_mm, z_mm);
      return on && any_arc_on(contour_through(*on), z_mm);
    };
    const double h = field_.kernel_width_mm(node.node.place_mm);
    return {about(last_of(down.path_mm.back().z(), ring.z_mm, h, is_followed), at), true};
  }

  /// The heights in which the search may have been off.
  [[nodiscard]] HeightRange about(double z_mm, const Arrivals& at) const {
    const ReebNode& node = built_[at.node].node;
    return {z_mm, std::min(z_mm + kUnseenKernels * field_.kernel_width_mm(node.place_mm), node.low_mm)};
  }

  /// Several arrive: they became one since the second of them began.
  [[nodiscard]] double became_one(const Arrivals& at) const {
    std::vector<double> begins;
    for (const std::size_t a : at.arcs) begins.push_back(parts_.nodes[parts_.arcs[a].lower].high_mm);
    std::nth_element(begins.begin(), begins.begin() + 1, begins.end());
    const NodeRings& node = built_[at.node];
    const auto are_apart = [&](double z_mm) {
      std::vector<Ring> seen;
      for (const std::size_t a : at.arcs)
        if (const auto p = point_at_height(parts_.arcs[a].path_mm, z_mm)) {
          if (std::any_of(seen.begin(), seen.end(), [&](const Ring& r) { return is_on(r, *p); })) return false;
          if (auto ring = contour_through(*p)) seen.push_back(std::move(*ring));
        }
      return true;
    };
    return last_of(begins[1], node.node.low_mm, field_.kernel_width_mm(node.node.place_mm), are_apart);
  }

  /// A height from `low_mm` on at which something holds that does not at one little above. It does not at `high_mm`.
  template <class Holds>
  static double last_of(double low_mm, double high_mm, double kernel_mm, Holds&& holds) {
    while (high_mm - low_mm > kUnseenKernels * kernel_mm) {
      const double middle = (low_mm + high_mm) / 2;
      (holds(middle) ? low_mm : high_mm) = middle;
    }
    return low_mm;
  }

  [[nodiscard]] bool is_on(const Ring& ring, const Vec3& p) const {
    const double reach = kOnRingKernels * field_.kernel_width_mm(p);
    return ring.distance_mm(p.head<2>(), reach) < reach;
  }
  [[nodiscard]] std::optional<Ring> contour_through(const Vec3& p) const {
    return trace_ring(field_, cursor_, p, stop_);
  }
  [[nodiscard]] bool any_arc_on(const std::optional<Ring>& ring, double z_mm) const {
    return ring && std::any_of(parts_.arcs.begin(), parts_.arcs.end(), [&](const ReebArc& arc) {
             const auto p = point_at_height(arc.path_mm, z_mm);
             return p && is_on(*ring, *p);
           });
  }

  const ScalarField& field_;
  FieldCursor& cursor_;
  const CriticalIndex& index_;
  const HeightTopology::Parts& parts_;
  std::span<const NodeRings> built_;
  std::span<const std::size_t> node_of_;  ///< of critical points
  const std::stop_token& stop_;
};

/// Rising nodes merge pieces of the surface below them; the younger piece ends there. With `upwards` false the same
/// from above. Gives the extremum that begins the younger piece its height difference.
void pair_by_elder_rule(HeightTopology::Parts& parts, bool upwards) {
  std::vector<std::size_t> order(parts.nodes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  if (!upwards) std::reverse(order.begin(), order.end());
  std::vector<std::size_t> parent(parts.nodes.size());
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  const auto root = [&](std::size_t a) {
    while (parent[a] != a) a = parent[a] = parent[parent[a]];
    return a;
  };
  const auto age = [&](std::size_t n) { return upwards ? parts.nodes[n].low_mm : -parts.nodes[n].high_mm; };
  for (const std::size_t n : order) {
    std::vector<std::size_t> behind;
    for (const std::size_t a : upwards ? parts.nodes[n].arcs_below : parts.nodes[n].arcs_above)
      behind.push_back(root(upwards ? parts.arcs[a].lower : parts.arcs[a].upper));
    std::sort(behind.begin(), behind.end(),
              [&](auto a, auto b) { return std::pair(age(a), a) < std::pair(age(b), b); });
    behind.erase(std::unique(behind.begin(), behind.end()), behind.end());
    for (std::size_t k = 1; k < behind.size(); ++k) {
      const double life = age(n) - age(behind[k]);
      for (const std::size_t node : {behind[k], n})
        if (parts.nodes[node].critical_points.size() == 1) {
          double& persistence = parts.critical_points[parts.nodes[node].critical_points.front()].persistence_mm;
          persistence = std::min(persistence, life);
        }
      parent[behind[k]] = behind[0];
    }
    if (!behind.empty()) parent[n] = behind[0];
  }
}

void find_components(HeightTopology::Parts& parts, std::span<const NodeRings> built) {
  DisjointSets sets{parts.nodes.size()};
  for (const ReebArc& arc : parts.arcs)
    sets.join(static_cast<std::uint32_t>(arc.lower), static_cast<std::uint32_t>(arc.upper));
  const std::vector<std::uint32_t> numbers = sets.numbers();
  for (std::size_t n = 0; n < parts.nodes.size(); ++n) {
    if (numbers[n] == parts.components.size())
      parts.components.push_back({.low_mm = parts.nodes[n].low_mm, .high_mm = parts.nodes[n].high_mm});
    SurfaceComponent& c = parts.components[numbers[n]];
    parts.nodes[n].component = numbers[n];
    c.euler += built[n].euler;
    c.nodes += 1;
    c.low_mm = std::min(c.low_mm, parts.nodes[n].low_mm);
    c.high_mm = std::max(c.high_mm, parts.nodes[n].high_mm);
  }
  std::vector<bool> certain(parts.components.size(), true);
  for (const ReebNode& n : parts.nodes) certain[n.component] = certain[n.component] && n.resolved;
  for (std::size_t i = 0; i < parts.components.size(); ++i) {
    SurfaceComponent& c = parts.components[i];
    const bool possible = c.euler % 2 == 0 && c.euler <= 2;
    if (possible && certain[i]) c.genus = 1 - c.euler / 2;
    if (!possible)
      parts.inconsistencies.push_back(
          fmt::format("the surface piece from {:.3f} to {:.3f} mm has Euler number {}, which no "
                      "closed surface has",
                      c.low_mm, c.high_mm, c.euler));
  }
}

}  // namespace

Result<void> build_reeb_graph(const ScalarField& field, std::span<const Vec3> samples, std::span<const Vec3> normals,
                              HeightTopology::Parts& parts, double run_kernels, NodeMemory& memory,
                              std::stop_token stop) {
  const CriticalIndex index{field, parts.critical_points};
  auto traced =
      trace_nodes(field, samples, normals, parts.critical_points, parts.plateaus, index, run_kernels, memory, stop);
  if (!traced) return tl::unexpected{traced.error()};
  const std::vector<NodeRings>& built = traced->nodes;

  std::vector<std::size_t> node_of(parts.critical_points.size());
  struct Port {
    std::size_t node, ring;
  };
  std::vector<Port> ports;
  for (std::size_t n = 0; n < built.size(); ++n) {
    for (const std::size_t c : built[n].node.critical_points) node_of[c] = n;
    for (std::size_t r = 0; r < built[n].above.size(); ++r) ports.push_back({n, r});
  }

  std::vector<Meeting> meetings(ports.size());
  tbb::enumerable_thread_specific<std::unique_ptr<FieldCursor>> cursors([&] { return field.cursor(); });
  tbb::parallel_for(std::size_t{0}, ports.size(), [&](std::size_t k) {
    if (!stop.stop_requested())
      meetings[k] = follow_up(field, *cursors.local(), *traced, index, node_of, ports[k].node, ports[k].ring, stop);
  });
  if (stop.stop_requested()) return cancelled("building the Reeb graph");

  std::vector<std::vector<std::vector<std::size_t>>> met(built.size());  // arcs, by node and ring
  for (std::size_t n = 0; n < built.size(); ++n) {
    parts.nodes.push_back(built[n].node);
    parts.nodes.back().euler_step = built[n].euler_step;
    met[n].resize(built[n].below.size());
    if (!built[n].inconsistency.empty())
      parts.inconsistencies.push_back(
          fmt::format("at {}: {}", place_text(built[n].node.place_mm), built[n].inconsistency));
  }
  const auto blind_about = [&](const Vec3& loss) {
    const double h = field.kernel_width_mm(loss);
    parts.blind.push_back({loss.z() - 0.5 * h, loss.z() + 0.5 * h});
    parts.losses_mm.push_back(loss);
  };
  for (std::size_t k = 0; k < ports.size(); ++k) {
    Meeting& m = meetings[k];
    const NodeRings& from = built[ports[k].node];
    for (const Vec3& loss : m.losses) {
      parts.inconsistencies.push_back(fmt::format("the contour that begins at {} was lost at {} and found elsewhere",
                                                  place_text(from.node.place_mm), place_text(loss)));
      blind_about(loss);
    }
    if (!m.node) {
      parts.inconsistencies.push_back(fmt::format("the contour that begins at {} was lost {}",
                                                  place_text(from.node.place_mm),
                                                  m.path.empty() ? "at once" : "at " + place_text(m.path.back())));
      blind_about(m.path.empty() ? from.node.place_mm : m.path.back());
      continue;
    }
    if (m.ring)
      met[*m.node][*m.ring].push_back(parts.arcs.size());
    else if (!built[*m.node].below.empty() || built[*m.node].node.plateau)
      parts.inconsistencies.push_back(fmt::format("the contour that begins at {} reaches {} beside its rings",
                                                  place_text(from.node.place_mm),
                                                  place_text(built[*m.node].node.place_mm)));
    const std::size_t arc = parts.arcs.size();
    parts.nodes[ports[k].node].arcs_above.push_back(arc);
    parts.nodes[*m.node].arcs_below.push_back(arc);
    parts.arcs.push_back({ports[k].node, *m.node, from.above[ports[k].ring].is_hole(), std::move(m.path)});
  }
  std::vector<Arrivals> amiss;
  for (std::size_t n = 0; n < built.size(); ++n)
    for (std::size_t r = 0; r < met[n].size(); ++r) {
      if (met[n][r].size() == 1) continue;
      parts.inconsistencies.push_back(
          fmt::format("{} contours arrive at one ring below {}", met[n][r].size(), place_text(built[n].node.place_mm)));
      amiss.push_back({n, r, std::move(met[n][r])});
    }
  std::vector<Unseen> unseen(amiss.size());
  tbb::parallel_for(std::size_t{0}, amiss.size(), [&](std::size_t k) {
    if (!stop.stop_requested())
      unseen[k] = UnseenHeights{field, *cursors.local(), index, parts, built, node_of, stop}.below(amiss[k]);
  });
  if (stop.stop_requested()) return cancelled("building the Reeb graph");
  for (std::size_t k = 0; k < amiss.size(); ++k) {
    parts.blind.push_back(unseen[k].at);
    // Sums from above end at the ring: one slice counted below it tells whether nothing else was missed.
    const double ring_mm = built[amiss[k].node].node.low_mm;
    if (unseen[k].hides) parts.blind.push_back({ring_mm, ring_mm});
  }

  for (IntegralLine& line : traced->lines)
    if (parts.critical_points[line.saddle].is_saddle()) parts.lines.push_back(std::move(line));
  find_components(parts, built);
  pair_by_elder_rule(parts, true);
  pair_by_elder_rule(parts, false);
  return {};
}

}  // namespace telefab::scan::topology
