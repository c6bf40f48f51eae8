// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/scan/topology/height_topology.hpp>

#include "critical_search.hpp"
#include "plateaus.hpp"
#include "reeb_graph.hpp"

namespace telefab::scan {

namespace {
// Critical heights nearer than this (in kernel widths) are not put in order.
constexpr double kFineRun = 0.01;
constexpr double kCoarseRun = 0.04;
/// A scan too rough for its kernel leaves hundreds of inconsistencies, which no second look at the same surface takes
/// away.
constexpr std::size_t kHopeless = 50;
}  // namespace

std::string_view name_of(CriticalKind kind) {
  switch (kind) {
    case CriticalKind::Minimum:
      return "minimum";
    case CriticalKind::BottomSaddle:
      return "bottom saddle";
    case CriticalKind::TopSaddle:
      return "top saddle";
    case CriticalKind::Maximum:
      return "maximum";
  }
  return "unknown";
}

int CriticalPoint::euler_step() const {
  switch (kind) {
    case CriticalKind::Minimum:
      return normal_up ? -1 : 1;  // a pocket's or void's floor opens a hole
    case CriticalKind::Maximum:
      return normal_up ? -1 : 1;  // a void's ceiling closes one
    case CriticalKind::BottomSaddle:
      return 1;
    case CriticalKind::TopSaddle:
      return -1;
  }
  return 0;
}

Result<void> TopologyOptions::validate() const {
  if (!(min_start_nz > 0 && min_start_nz < 1))
    return fail(ErrorCode::InvalidInput, "min_start_nz must lie between 0 and 1");
  if (!(near_critical_kernels > 0 && near_critical_kernels <= 1))
    return fail(ErrorCode::InvalidInput, "near_critical_kernels must lie in (0, 1]");
  if (!(sharp_bend > 0)) return fail(ErrorCode::InvalidInput, "sharp_bend must be positive");
  if (!(sharp_reach_kernels >= 0 && sharp_reach_kernels <= 1))
    return fail(ErrorCode::InvalidInput, "sharp_reach_kernels must lie in [0, 1]");
  if (!(noise_mm >= 0)) return fail(ErrorCode::InvalidInput, "noise_mm must not be negative");
  if (max_critical_points < 1) return fail(ErrorCode::InvalidInput, "max_critical_points must be at least 1");
  return {};
}

HeightTopology::HeightTopology(Parts parts) : parts_{std::move(parts)} {
  const auto add = [&](double low, double high, std::optional<int> step) {
    events_.push_back({low, Event::Kind::Begins, step});
    events_.push_back({high, Event::Kind::Ends, step});
  };
  for (const ReebNode& n : parts_.nodes)
    add(n.low_mm, n.high_mm, n.resolved ? std::optional{n.euler_step} : std::nullopt);
  for (const HeightRange& b : parts_.blind) add(b.low_mm, b.high_mm, std::nullopt);
  std::stable_sort(events_.begin(), events_.end(), [](const Event& x, const Event& y) { return x.z_mm < y.z_mm; });
  if (const auto left = sum_up(); left && *left != 0)
    parts_.inconsistencies.push_back(
        fmt::format("the critical points leave {} contours open above the top; one was missed", *left));
  // Apart from each other and rising.
  std::vector<HeightRange>& near = parts_.near;
  std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.low_mm < b.low_mm; });
  std::size_t last = 0;
  for (std::size_t i = 1; i < near.size(); ++i)
    if (near[i].low_mm <= near[last].high_mm)
      near[last].high_mm = std::max(near[last].high_mm, near[i].high_mm);
    else
      near[++last] = near[i];
  if (!near.empty()) near.resize(last + 1);
}

std::optional<int> HeightTopology::sum_up() {
  const std::size_t count = events_.size();
  // The sum beyond an event that is passed upwards (way 1) or downwards (-1).
  const auto beyond = [](std::optional<Sum> sum, const Event& event, int way) -> std::optional<Sum> {
    if (event.kind == Event::Kind::Counted) return Sum{*event.value, true};
    if (event.kind == Event::Kind::Begins || !sum) return sum;
    return event.value ? std::optional{Sum{sum->euler + way * *event.value, sum->counted}} : std::nullopt;
  };
  std::vector<std::optional<Sum>> from_below(count), from_above(count);
  std::optional<Sum> left = Sum{};
  for (std::size_t e = 0; e < count; ++e) from_below[e] = left = beyond(left, events_[e], 1);
  std::optional<Sum> sum = Sum{};
  for (std::size_t e = count; e-- > 0; sum = beyond(sum, events_[e], -1)) from_above[e] = sum;
  above_.assign(count, std::nullopt);
  int inside = 0;
  for (std::size_t e = 0; e < count; ++e) {
    inside += events_[e].deeper();
    if (inside > 0) continue;
    const auto &below = from_below[e], &above = from_above[e];
    if (below && above && below->euler != above->euler) continue;
    if (below && above)
      above_[e] = Sum{below->euler, below->counted && above->counted};
    else
      above_[e] = below ? below : above;
  }
  return left ? std::optional{left->euler} : std::nullopt;
}

std::size_t HeightTopology::events_up_to(double z_mm) const {
  const auto after = std::upper_bound(events_.begin(), events_.end(), z_mm,
                                      [](double z, const Event& event) { return z < event.z_mm; });
  return static_cast<std::size_t>(after - events_.begin());
}

std::vector<HeightRange> HeightTopology::uncounted() const {
  std::vector<HeightRange> ranges;
  bool goes_on = false;
  int inside = 0, blind = 0;
  for (std::size_t e = 0; e + 1 < events_.size(); ++e) {
    const Event& event = events_[e];
    inside += event.deeper();
    if (!event.value) blind += event.deeper();
    if (event.kind == Event::Kind::Counted) goes_on = false;
    if (blind > 0 || above_[e]) {
      goes_on = false;
    } else if (goes_on) {
      ranges.back().high_mm = events_[e + 1].z_mm;
    } else if (inside == 0) {  // within a node there is nothing to count
      ranges.push_back({event.z_mm, events_[e + 1].z_mm});
      goes_on = true;
    }
  }
  return ranges;
}

void HeightTopology::count(double z_mm, int euler) {
  const auto before = static_cast<std::ptrdiff_t>(events_up_to(z_mm));
  events_.insert(events_.begin() + before, {z_mm, Event::Kind::Counted, euler});
  sum_up();
}

int HeightTopology::euler() const {
  int sum = 0;
  for (const SurfaceComponent& c : parts_.components) sum += c.euler;
  return sum;
}

bool HeightTopology::euler_is_certain() const {
  return !parts_.components.empty() && std::all_of(parts_.components.begin(), parts_.components.end(),
                                                   [](const SurfaceComponent& c) { return c.genus.has_value(); });
}

std::optional<int> HeightTopology::predicted_euler(double z_mm) const {
  const std::size_t below = events_up_to(z_mm);
  if (below == 0) return 0;
  const auto& sum = above_[below - 1];
  return sum ? std::optional{sum->euler} : std::nullopt;
}

bool HeightTopology::rests_on_a_count(double z_mm) const {
  const std::size_t below = events_up_to(z_mm);
  return below > 0 && above_[below - 1] && above_[below - 1]->counted;
}

std::optional<ContourCount> HeightTopology::predicted_contours(double z_mm) const {
  const auto euler = predicted_euler(z_mm);
  if (!euler) return std::nullopt;
  ContourCount count;
  for (const ReebArc& a : parts_.arcs)
    if (parts_.nodes[a.lower].high_mm < z_mm && z_mm < parts_.nodes[a.upper].low_mm)
      ++(a.hole ? count.holes : count.outers);
  if (count.outers - count.holes != *euler) return std::nullopt;
  return count;
}

bool HeightTopology::is_near_critical(double z_mm) const {
  const auto after = std::upper_bound(parts_.near.begin(), parts_.near.end(), z_mm,
                                      [](double z, const HeightRange& n) { return z < n.low_mm; });
  return after != parts_.near.begin() && z_mm <= std::prev(after)->high_mm;
}

std::optional<Vec3> HeightTopology::rounded_near(double z_mm) const {
  return rounded_near(z_mm, [](const Vec3&) { return true; });
}

std::optional<Vec3> HeightTopology::rounded_near(double z_mm, const std::function<bool(const Vec3&)>& counts) const {
  for (const RoundedInterval& r : parts_.rounded)
    if (r.low_mm <= z_mm && z_mm <= r.high_mm && counts(r.place_mm)) return r.place_mm;
  return std::nullopt;
}

bool HeightTopology::is_inconsistent(double z_mm, double within_mm) const {
  const auto near = [&](double low, double high) { return low - within_mm <= z_mm && z_mm <= high + within_mm; };
  return std::any_of(parts_.blind.begin(), parts_.blind.end(),
                     [&](const auto& b) { return near(b.low_mm, b.high_mm); }) ||
         std::any_of(parts_.nodes.begin(), parts_.nodes.end(),
                     [&](const auto& n) { return !n.resolved && near(n.low_mm, n.high_mm); });
}

std::vector<ContourSeed> HeightTopology::seeds(double z_mm) const {
  std::vector<ContourSeed> found;
  for (std::size_t a = 0; a < parts_.arcs.size(); ++a) {
    const ReebArc& arc = parts_.arcs[a];
    if (!(parts_.nodes[arc.lower].high_mm < z_mm && z_mm < parts_.nodes[arc.upper].low_mm)) continue;
    std::optional<Vec3> p = topology::point_at_height(arc.path_mm, z_mm);
    if (!p && !arc.path_mm.empty()) {
      // Between a plateau and the ring where the path begins or ends.
      p = z_mm < arc.path_mm.front().z() ? arc.path_mm.front() : arc.path_mm.back();
      p->z() = z_mm;
    }
    if (p) found.push_back({*p, arc.hole, a});
  }
  return found;
}

Result<HeightTopology> analyse_height(const ScalarField& field, const SampleView& samples,
                                      const TopologyOptions& options, std::stop_token stop) {
  if (const auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  if (samples.points.empty())
    return fail(ErrorCode::InvalidInput, "no samples of the surface; critical points cannot be searched");
  if (samples.points.size() != samples.normals.size())
    return fail(ErrorCode::InvalidInput, fmt::format("{} samples but {} normals; give one normal a sample",
                                                     samples.points.size(), samples.normals.size()));
  const topology::SearchWidth narrow{.least_nz = options.min_start_nz};
  const topology::SearchWidth wide{
      .least_nz = 0.5 * options.min_start_nz, .cell_kernels = 0.3, .first_step_kernels = 4};
  const std::vector<Vec3> starts = topology::candidates(field, samples.points, samples.normals, narrow);
  auto points = topology::find_critical_points(field, starts, narrow, stop);
  if (!points) return tl::unexpected{points.error()};

  std::vector<topology::LevelPlace> level_ones = topology::level_places(field, starts);
  topology::NodeMemory memory;
  const auto build = [&](double run_kernels) -> Result<HeightTopology> {
    if (points->size() > options.max_critical_points)
      return fail(ErrorCode::TooLarge, fmt::format("{} critical points, the limit is {}; use a wider kernel",
                                                   points->size(), options.max_critical_points));
    HeightTopology::Parts parts;
    parts.critical_points = *points;
    parts.plateaus = topology::gather_plateaus(field, level_ones, parts.critical_points, options.near_critical_kernels);
    for (const Plateau& p : parts.plateaus) parts.near.push_back({p.low_mm, p.high_mm});
    for (const CriticalPoint& c : parts.critical_points) {
      const double h = field.kernel_width_mm(c.position_mm);
      const double near = options.near_critical_kernels * h;
      parts.near.push_back({c.position_mm.z() - near, c.position_mm.z() + near});
      if (c.plateau) {
        HeightRange& level = parts.near[*c.plateau];
        const Plateau& p = parts.plateaus[*c.plateau];
        level.low_mm = std::min(level.low_mm, p.low_mm - near);
        level.high_mm = std::max(level.high_mm, p.high_mm + near);
      }
      if (c.plateau || h * c.curvature_per_mm.cwiseAbs().maxCoeff() < options.sharp_bend) continue;
      const double off = options.sharp_reach_kernels * h;
      parts.rounded.push_back({c.position_mm.z() - off, c.position_mm.z() + off, c.position_mm});
    }
    if (parts.critical_points.empty()) {
      const Box3 box = field.bounds();
      parts.blind.push_back({box.min.z(), box.max.z()});
      parts.inconsistencies.push_back(
          "no critical point was found, a closed surface has at least two; the samples are too few");
    }
    if (const auto built =
            topology::build_reeb_graph(field, samples.points, samples.normals, parts, run_kernels, memory, stop);
        !built)
      return tl::unexpected{built.error()};
    return HeightTopology{std::move(parts)};
  };
  // Where points and graph contradict each other: first order heights less finely, then search more widely at the
  // inconsistent heights. The first result without inconsistencies is taken, else the one with the fewest.
  auto best = build(kFineRun);
  if (!best || best->inconsistencies().empty() || best->inconsistencies().size() > kHopeless) return best;
  if (auto coarse = build(kCoarseRun); !coarse)
    return coarse;
  else if (coarse->inconsistencies().size() < best->inconsistencies().size())
    best = std::move(coarse);
  if (best->inconsistencies().empty()) return best;

  std::vector<Vec3> near_inconsistency = topology::candidates(field, samples.points, samples.normals, wide);
  std::erase_if(near_inconsistency,
                [&](const Vec3& p) { return !best->is_inconsistent(p.z(), field.kernel_width_mm(p)); });
  near_inconsistency.insert(near_inconsistency.end(), best->losses().begin(), best->losses().end());
  auto more = topology::find_critical_points(field, near_inconsistency, wide, stop);
  if (!more) return tl::unexpected{more.error()};
  const auto more_level_ones = topology::level_places(field, near_inconsistency);
  level_ones.insert(level_ones.end(), more_level_ones.begin(), more_level_ones.end());
  points = topology::merged(field, std::move(*points), *more);
  memory = {};
  for (const double run : {kFineRun, kCoarseRun}) {
    auto again = build(run);
    if (!again) return again;
    if (again->inconsistencies().size() < best->inconsistencies().size()) best = std::move(again);
    if (best->inconsistencies().empty()) break;
  }
  return best;
}

}  // namespace telefab::scan
