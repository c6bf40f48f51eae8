// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <telefab/fab/support/covering.hpp>

#include "clipped_cells.hpp"

namespace telefab::fab {
namespace {

constexpr double kSafety = 0.999;  ///< we solve for a hair less than promised, so that rounding cannot break it
constexpr double kSearchTolerance = 0.003;  ///< of the reach
constexpr double kSmall = 60;               ///< wanted anchors below which both starts are tried
constexpr std::size_t kFew = 24;            ///< anchors below which all of them move to close a gap
constexpr std::size_t kMaxAnchors = 200'000;
const double kHexArea = 1.5 * std::sqrt(3.0);  ///< of the hexagon inside the unit circle

double distance(Flat a, Flat b) { return std::sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)); }

struct State {
  std::vector<Flat> sites;
  std::vector<ClippedCell> cells;
  double worst = 0;
};

class Solver {
 public:
  Solver(const CellRegion& region, const CoveringOptions& options, std::stop_token stop)
      : region_{region}, options_{options}, stop_{std::move(stop)} {}

  [[nodiscard]] int sweeps() const { return sweeps_; }

  /// Takes over what was found on a coarser picture of the region, measures every cell, and adds anchors should
  /// anything be out of reach.
  Result<State> prove(const State& found, const CellRegion& coarse) {
    std::vector<Flat> sites;
    for (const Flat& site : found.sites) {
      Flat place = region_.from_mm(coarse.to_mm(site));
      if (!region_.inside(place)) place = region_.nudged_inside(region_.nearest_boundary(place));
      sites.push_back(place);
    }
    State state = measured(std::move(sites));
    while (state.worst > 1) {
      if (stop_.stop_requested()) return cancelled("covering");
      if (state.sites.size() > kMaxAnchors)
        return fail(ErrorCode::TooLarge, fmt::format("covering: more than {} anchors", kMaxAnchors));
      add_where_out_of_reach(state);
    }
    return state;
  }

  /// From few anchors upwards and, where that is cheap or promising, from a full lattice downwards; the fewer win.
  Result<State> solve() {
    const double wanted = region_.area() / kHexArea;
    if (options_.plain) return grown_to_cover(inner_lattice(wanted));
    auto best = grown_to_cover(wanted < kSmall ? inner_lattice(wanted) : full_lattice());
    if (!best || wanted >= kSmall) return best;
    auto other = grown_to_cover(full_lattice());
    if (other && other->sites.size() < best->sites.size()) return other;
    return best;
  }

 private:
  State measured(std::vector<Flat> sites) {
    State state;
    state.sites = std::move(sites);
    measure(state);
    return state;
  }

  void measure(State& state) {
    state.cells = region_.cells(state.sites);
    state.worst = 0;
    for (const ClippedCell& cell : state.cells) state.worst = std::max(state.worst, cell.farthest_distance);
    ++sweeps_;
  }

  Result<State> grown_to_cover(std::vector<Flat> start) {
    State state = measured(std::move(start));
    for (;;) {
      relax(state, options_.sweeps);
      if (stop_.stop_requested()) return cancelled("covering");
      if (state.worst <= 1) break;
      if (state.sites.size() > kMaxAnchors)
        return fail(ErrorCode::TooLarge,
                    fmt::format("covering: more than {} anchors; give a larger anchor distance", kMaxAnchors));
      add_where_out_of_reach(state);
    }
    if (options_.plain) return state;
    // Near the gap first, which is quick; of few anchors all may move for what is left.
    thin_out(state, options_.removals, state.sites.size() < kFew);
    if (state.sites.size() >= kFew && static_cast<double>(state.sites.size()) < kSmall)
      thin_out(state, options_.removals / 2, true);
    return state;
  }

  /// Lattice points row by row, forth and back, so that neighbours in the list are neighbours in the plane.
  std::vector<Flat> lattice(double x0, double y0) const {
    const double dx = std::sqrt(3.0), dy = 1.5;
    std::vector<Flat> sites;
    int row = 0;
    for (double y = y0 - dy; y < region_.most().y + dy; y += dy, ++row) {
      const std::size_t first = sites.size();
      for (double x = x0 + (row % 2) * dx / 2 - 2 * dx; x < region_.most().x + dx; x += dx) sites.push_back({x, y});
      if (row % 2) std::reverse(sites.begin() + static_cast<std::ptrdiff_t>(first), sites.end());
    }
    return sites;
  }

  /// The area's count: lattice points inside, of the shift that has most of them well inside.
  std::vector<Flat> inner_lattice(double wanted) {
    if (wanted < 4) return {seed()};
    std::vector<Flat> best;
    for (int shift = 0; shift < 4; ++shift) {
      std::vector<Flat> sites = lattice((shift & 1) ? 0.0 : 0.87, (shift & 2) ? 0.35 : 0.75);
      std::erase_if(sites, [&](Flat p) { return !region_.inside(p); });
      if (sites.size() > best.size()) best = std::move(sites);
    }
    if (best.empty()) best = {seed()};
    return best;
  }

  /// One anchor for every hexagon that holds a piece of the region worth naming, moved inside where its centre lies
  /// outside. The shift with the fewest.
  std::vector<Flat> full_lattice() {
    std::vector<Flat> best;
    for (int shift = 0; shift < 4; ++shift) {
      const std::vector<Flat> centres = lattice((shift & 1) ? 0.0 : 0.87, (shift & 2) ? 0.35 : 0.75);
      const auto cells = region_.cells(centres);
      ++sweeps_;
      std::vector<Flat> sites;
      for (std::size_t i = 0; i < centres.size(); ++i) {
        const ClippedCell& cell = cells[i];
        if (cell.area < 0.05) continue;
        if (region_.inside(centres[i]))
          sites.push_back(centres[i]);
        else if (region_.inside(cell.circle_centre))
          sites.push_back(cell.circle_centre);
        else
          sites.push_back(region_.nudged_inside(region_.nearest_boundary(cell.circle_centre)));
      }
      if (best.empty() || (!sites.empty() && sites.size() < best.size())) best = std::move(sites);
    }
    if (best.empty()) best = {seed()};
    return best;
  }

  Flat seed() {
    const Flat middle{region_.most().x / 2, region_.most().y / 2};
    if (region_.inside(middle)) return middle;
    return region_.nudged_inside(region_.nearest_boundary(middle));
  }

  Flat moved_inside(Flat site, Flat target) {
    return region_.inside(target) ? target : region_.last_inside(site, target);
  }

  /// Lloyd sweeps; keeps the best state seen. Centroids spread the sites, circle centres shrink the worst cell.
  void relax(State& state, int sweeps) {
    State best = state;
    for (int sweep = 0; sweep < sweeps && best.worst > 1; ++sweep) {
      if (stop_.stop_requested()) break;
      for (std::size_t i = 0; i < state.sites.size(); ++i) {
        const ClippedCell& cell = state.cells[i];
        if (cell.area <= 0 && cell.farthest_distance <= 0) continue;
        const double w = options_.plain ? 1.0 : sweep < 2 && state.worst > 1.2 ? 0.5 : 0.0;
        const Flat target{cell.circle_centre.x + w * (cell.centroid.x - cell.circle_centre.x),
                          cell.circle_centre.y + w * (cell.centroid.y - cell.circle_centre.y)};
        state.sites[i] = moved_inside(state.sites[i], target);
      }
      measure(state);
      if (state.worst < best.worst) best = state;
    }
    state = std::move(best);
  }

  /// In bursts: where one closes less than a third of what is open, the others will not close it.
  void relax_while_it_closes(State& state, int sweeps, int burst) {
    for (int left = sweeps; left > 0 && state.worst > 1; left -= burst) {
      const double open = state.worst - 1;
      relax(state, std::min(burst, left));
      if (state.worst - 1 > 0.67 * open) break;
    }
  }

  /// One new anchor at every point out of reach, farthest first, none within reach of a new one before it.
  void add_where_out_of_reach(State& state) {
    std::vector<std::uint32_t> order(state.cells.size());
    std::iota(order.begin(), order.end(), 0U);
    std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
      return state.cells[a].farthest_distance > state.cells[b].farthest_distance;
    });
    std::vector<Flat> fresh;
    for (const std::uint32_t i : order) {
      const ClippedCell& cell = state.cells[i];
      if (cell.farthest_distance <= 1) break;
      if (std::any_of(fresh.begin(), fresh.end(), [&](Flat p) { return distance(p, cell.farthest) < 2.2; })) continue;
      // A step from the far point towards its site, as far as a new anchor still reaches it.
      const double back = std::min(0.5, cell.farthest_distance / 3) / cell.farthest_distance;
      Flat place{cell.farthest.x + back * (state.sites[i].x - cell.farthest.x),
                 cell.farthest.y + back * (state.sites[i].y - cell.farthest.y)};
      if (!region_.inside(place)) place = region_.nudged_inside(region_.nearest_boundary(cell.farthest));
      fresh.push_back(place);
      if (options_.plain) break;
    }
    state.sites.insert(state.sites.end(), fresh.begin(), fresh.end());
    measure(state);
  }

  /// Takes away one anchor after the other, those with the smallest cells first, where the neighbours can close the
  /// gap. Only the surroundings of the gap are relaxed and measured again.
  void thin_out(State& state, int tries, bool all_move) {
    std::vector<char> failed(state.sites.size(), 0);
    while (tries-- > 0 && state.sites.size() > 1 && !stop_.stop_requested()) {
      std::size_t least = state.sites.size();
      for (std::size_t i = 0; i < state.sites.size(); ++i)
        if (!failed[i] && (least == state.sites.size() || state.cells[i].area < state.cells[least].area)) least = i;
      if (least == state.sites.size()) break;
      if (!(all_move ? closed_by_all(state, least) : closed_without(state, least))) {
        failed[least] = 1;
        continue;
      }
      failed.erase(failed.begin() + static_cast<std::ptrdiff_t>(least));
      ++tries;
    }
  }

  /// For few anchors: all of them move.
  bool closed_by_all(State& state, std::size_t gone) {
    State fewer;
    fewer.sites = state.sites;
    fewer.sites.erase(fewer.sites.begin() + static_cast<std::ptrdiff_t>(gone));
    measure(fewer);
    relax_while_it_closes(fewer, 2 * options_.sweeps, 4);
    if (fewer.worst > 1) return false;
    state = std::move(fewer);
    return true;
  }

  bool closed_without(State& state, std::size_t gone) {
    constexpr double kMoves = 3.2, kSeen = 6.5;
    const Flat hole = state.sites[gone];
    std::vector<std::uint32_t> members;
    State local;
    std::vector<char> moves;
    for (std::uint32_t i = 0; i < state.sites.size(); ++i) {
      const double d = distance(state.sites[i], hole);
      if (i == gone || d > kSeen) continue;
      members.push_back(i);
      local.sites.push_back(state.sites[i]);
      moves.push_back(d < kMoves);
    }
    if (members.empty()) return false;
    const auto judged = [&](std::size_t i) { return distance(local.sites[i], hole) < kMoves + 1.9; };
    const auto look = [&] {
      local.cells = region_.cells(local.sites, judged_mask(local.sites, hole, kMoves + 1.9));
      local.worst = 0;
      for (std::size_t i = 0; i < local.sites.size(); ++i)
        if (judged(i)) local.worst = std::max(local.worst, local.cells[i].farthest_distance);
    };
    look();
    for (int sweep = 0; sweep < options_.sweeps && local.worst > 1; ++sweep) {
      for (std::size_t i = 0; i < local.sites.size(); ++i)
        if (moves[i]) local.sites[i] = moved_inside(local.sites[i], local.cells[i].circle_centre);
      look();
    }
    ++sweeps_;
    if (local.worst > 1) return false;
    for (std::size_t i = 0; i < members.size(); ++i)
      if (judged(i)) state.sites[members[i]] = local.sites[i], state.cells[members[i]] = local.cells[i];
    state.sites.erase(state.sites.begin() + static_cast<std::ptrdiff_t>(gone));
    state.cells.erase(state.cells.begin() + static_cast<std::ptrdiff_t>(gone));
    return true;
  }

  static std::vector<char> judged_mask(const std::vector<Flat>& sites, Flat hole, double radius) {
    std::vector<char> mask;
    for (const Flat& p : sites) mask.push_back(distance(p, hole) < radius);
    return mask;
  }

  const CellRegion& region_;
  const CoveringOptions& options_;
  std::stop_token stop_;
  int sweeps_ = 0;
};

std::vector<Point2> sorted(std::vector<Point2> points) {
  std::sort(points.begin(), points.end(),
            [](Point2 a, Point2 b) { return a.y_mm != b.y_mm ? a.y_mm < b.y_mm : a.x_mm < b.x_mm; });
  return points;
}

}  // namespace

Result<void> CoveringOptions::validate() const {
  if (!(anchor_distance.count() > 0 && anchor_distance.count() <= 1000))
    return fail(ErrorCode::InvalidInput, "covering: the anchor distance must be above 0 and at most 1000 mm");
  if (sweeps < 1 || sweeps > 1000) return fail(ErrorCode::InvalidInput, "covering: sweeps must be 1 to 1000");
  if (removals < 0) return fail(ErrorCode::InvalidInput, "covering: removals must not be negative");
  return {};
}

Result<Covering> cover_region(const Region& region, const CoveringOptions& options, std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  Covering covering;
  if (region.empty()) return covering;
  const double unit = options.anchor_distance.count() * kSafety;
  if (covering_lower_bound(region, options.anchor_distance) > static_cast<double>(kMaxAnchors))
    return fail(ErrorCode::TooLarge,
                fmt::format("covering: more than {} anchors; give a larger anchor distance", kMaxAnchors));
  // The search runs on a region with fewer vertices for a reach shortened by as much; the proof on the region itself.
  const Millimetres tolerance{unit * kSearchTolerance};
  Region coarse = simplified(region, tolerance);
  if (coarse.empty() || coarse.area_mm2() < region.area_mm2() * 0.5) coarse = region;
  const double search_unit = unit * (1 - kSearchTolerance);
  const CellRegion search_region{coarse, search_unit};
  Solver solver{search_region, options, stop};
  auto found = solver.solve();
  if (!found) return tl::unexpected{found.error()};
  const CellRegion flat{region, unit};
  Solver prover{flat, options, std::move(stop)};
  const auto state = prover.prove(*found, search_region);
  if (!state) return tl::unexpected{state.error()};
  for (const Flat& site : state->sites) covering.anchors.push_back(flat.to_mm(site));
  covering.anchors = sorted(std::move(covering.anchors));
  covering.worst_mm = state->worst * unit;
  covering.sweeps = solver.sweeps() + prover.sweeps();
  return covering;
}

std::vector<Point2> grid_covering(const Region& region, Millimetres anchor_distance) {
  if (region.empty()) return {};
  const double r = anchor_distance.count(), step = r * std::sqrt(2.0);
  const Bounds2 box = region.bounds();
  std::vector<Point2> anchors;
  std::vector<Region> reach;
  const auto add = [&](Point2 p) {
    anchors.push_back(p);
    reach.push_back(disc(p, anchor_distance, Millimetres{r / 2000}));
  };
  for (double y = box.min.y_mm + step / 2; y - step / 2 < box.max.y_mm; y += step)
    for (double x = box.min.x_mm + step / 2; x - step / 2 < box.max.x_mm; x += step)
      if (region.contains({x, y})) add({x, y});
  const Region rest = subtract(region, unite(reach));
  for (double y = box.min.y_mm + step / 2; y - step / 2 < box.max.y_mm; y += step)
    for (double x = box.min.x_mm + step / 2; x - step / 2 < box.max.x_mm; x += step) {
      const double h = step / 2;
      const std::vector<GridRing> square{
          {to_grid({x - h, y - h}), to_grid({x + h, y - h}), to_grid({x + h, y + h}), to_grid({x - h, y + h})}};
      Region left = intersect(rest, Region::from_rings(square).value_or(Region{}));
      while (left.area_mm2() > 1e-5 * r * r) {
        // As near to the middle of what is left as the region allows.
        const Bounds2 b = left.bounds();
        Point2 p{(b.min.x_mm + b.max.x_mm) / 2, (b.min.y_mm + b.max.y_mm) / 2};
        if (!region.contains(p)) p = to_mm(left.rings().front().front());
        anchors.push_back(p);
        left = subtract(left, disc(p, anchor_distance, Millimetres{r / 2000}));
      }
    }
  return sorted(std::move(anchors));
}

double covering_lower_bound(const Region& region, Millimetres anchor_distance) {
  const double r = anchor_distance.count();
  return std::ceil(region.area_mm2() / (kHexArea * r * r));
}

}  // namespace telefab::fab
