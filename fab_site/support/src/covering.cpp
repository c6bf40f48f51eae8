#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <telefab/fab/support/covering.hpp>

#include "clipped_cells.hpp"

namespace telefab::fab {
namespace {

constexpr double kSafety = 0.999;  ///< we solve for a hair less than promised, so that rounding cannot break it
constexpr std::size_t kMaxAnchors = 200'000;
const double kHexArea = 1.5 * std::sqrt(3.0);  ///< of the hexagon inside the unit circle

double distance(Flat a, Flat b) { return std::hypot(a.x - b.x, a.y - b.y); }

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

  Result<State> solve() {
    State state = measured(lattice());
    for (;;) {
      relax(state, options_.sweeps);
      if (stop_.stop_requested()) return fail(ErrorCode::Cancelled, "covering: stopped");
      if (state.worst <= 1) break;
      if (state.sites.size() > kMaxAnchors)
        return fail(ErrorCode::TooLarge,
                    fmt::format("covering: more than {} anchors; give a larger anchor distance", kMaxAnchors));
      add_where_out_of_reach(state);
    }
    thin_out(state);
    return state;
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

  /// Row by row on a triangular lattice, so that neighbours in the list are neighbours in the plane; lattice points
  /// outside whose hexagon may still touch the region come in through the later insertions.
  std::vector<Flat> lattice() {
    std::vector<Flat> best;
    const double wanted = std::max(1.0, region_.area() / kHexArea);
    if (wanted < 4) return {seed()};
    const double dx = std::sqrt(3.0), dy = 1.5;
    const double width = region_.most().x, height = region_.most().y;
    double best_score = -1;
    for (int shift = 0; shift < 4; ++shift) {
      std::vector<Flat> sites;
      const double x0 = (shift & 1) ? 0.0 : dx / 2, y0 = (shift & 2) ? 0.35 : 0.75;
      int row = 0;
      for (double y = y0; y < height; y += dy, ++row) {
        const std::size_t first = sites.size();
        for (double x = x0 + (row % 2) * dx / 2 - dx; x < width; x += dx)
          if (region_.inside({x, y})) sites.push_back({x, y});
        if (row % 2) std::reverse(sites.begin() + static_cast<std::ptrdiff_t>(first), sites.end());
      }
      if (sites.empty()) continue;
      double covered = 0;
      const auto cells = region_.cells(sites);
      for (const ClippedCell& cell : cells) covered += std::min(cell.area, kHexArea) * (cell.farthest_distance <= 1);
      const double score = covered / static_cast<double>(sites.size());
      if (score > best_score) best_score = score, best = std::move(sites);
    }
    if (best.empty()) best = {seed()};
    return best;
  }

  Flat seed() {
    const Flat middle{region_.most().x / 2, region_.most().y / 2};
    if (region_.inside(middle)) return middle;
    return region_.nudged_inside(region_.nearest_boundary(middle));
  }

  Flat settled(Flat site, Flat target) { return region_.inside(target) ? target : region_.last_inside(site, target); }

  /// Lloyd sweeps; keeps the best state seen. Centroids spread the sites, circle centres shrink the worst cell.
  void relax(State& state, int sweeps) {
    State best = state;
    for (int sweep = 0; sweep < sweeps && best.worst > 1; ++sweep) {
      if (stop_.stop_requested()) break;
      for (std::size_t i = 0; i < state.sites.size(); ++i) {
        const ClippedCell& cell = state.cells[i];
        if (cell.area <= 0 && cell.farthest_distance <= 0) continue;
        const double w = sweep < 2 && state.worst > 1.2 ? 0.5 : 0.0;
        const Flat target{cell.circle_centre.x + w * (cell.centroid.x - cell.circle_centre.x),
                          cell.circle_centre.y + w * (cell.centroid.y - cell.circle_centre.y)};
        state.sites[i] = settled(state.sites[i], target);
      }
      measure(state);
      if (state.worst < best.worst) best = state;
    }
    state = std::move(best);
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
      if (!region_.inside(place)) place = region_.nudged_inside(cell.farthest);
      fresh.push_back(place);
    }
    state.sites.insert(state.sites.end(), fresh.begin(), fresh.end());
    measure(state);
  }

  /// Takes away one anchor after the other, those with the smallest cells first, where the rest can close the gap.
  void thin_out(State& state) {
    int tries = options_.removals;
    std::vector<Flat> failed;
    while (tries-- > 0 && state.sites.size() > 1 && !stop_.stop_requested()) {
      std::size_t least = state.sites.size();
      for (std::size_t i = 0; i < state.sites.size(); ++i) {
        const bool tried =
            std::any_of(failed.begin(), failed.end(), [&](Flat p) { return distance(p, state.sites[i]) < 1e-9; });
        if (!tried && (least == state.sites.size() || state.cells[i].area < state.cells[least].area)) least = i;
      }
      if (least == state.sites.size()) break;
      State fewer;
      fewer.sites = state.sites;
      fewer.sites.erase(fewer.sites.begin() + static_cast<std::ptrdiff_t>(least));
      measure(fewer);
      relax(fewer, options_.sweeps);
      if (fewer.worst <= 1)
        state = std::move(fewer);
      else
        failed.push_back(state.sites[least]);
    }
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
  const CellRegion flat{region, unit};
  Solver solver{flat, options, std::move(stop)};
  const auto state = solver.solve();
  if (!state) return tl::unexpected{state.error()};
  for (const Flat& site : state->sites) covering.anchors.push_back(flat.to_mm(site));
  covering.anchors = sorted(std::move(covering.anchors));
  covering.worst_mm = state->worst * unit;
  covering.sweeps = solver.sweeps();
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
        const Point2 p = to_mm(left.rings().front().front());
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
