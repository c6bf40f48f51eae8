// SPDX-License-Identifier: GPL-3.0-or-later
#include "curve_fit.hpp"

#include <algorithm>
#include <cmath>

#include "edge_fill.hpp"

namespace telefab::codec {
namespace {

constexpr int kMostDeleted = 4;           ///< vertices dropped in a row
constexpr int kLongestGap = 256;          ///< the same where there is no other way
constexpr int kMostGapTrials = 300;       ///< such ways tried for one ring
constexpr double kLargestMove = 64 * 40;  ///< lattice steps
constexpr double kTrackingWeight = 0.6;   ///< bits for an error of the whole tolerance: an exact move predicts the next
constexpr int kNear = 28;                 ///< target segments searched around the last hit

struct Candidate {
  std::int32_t level = 0;  ///< the residual; of a vertex without history the move in steps
  MovingVertex vertex;     ///< after the move
  double at = 0;           ///< on the target, counted on from the start's place
  double error_square = 0;
  double penalty = 0;
  // The best way here.
  double cost = kNever;
  int from_vertex = -1;
  int from_candidate = -1;
  std::int32_t residual = 0;
  std::int32_t residual_before = 0;  ///< of the vertex before on that way
  std::int32_t move = 0;
};

class Motion {
 public:
  Motion(const MovingRing& reference, std::span<const Place> target, const CurveModels& models, const FitRule& rule)
      : reference_{reference},
        target_{target},
        models_{models},
        rule_{rule},
        move_rule_{rule.steps.residual},
        filler_{target_, models.fill[0], rule},
        most_square_{square(rule.tolerance)},
        corners_{corners_of(reference)},
        hits_(reference.size()) {}

  std::optional<RingFit> fit() {
    find_hits();
    if (!choose_start()) return std::nullopt;
    find_candidates();
    for (std::size_t k = 1; k < ways_.size(); ++k)
      for (Candidate& c : ways_[k]) reach(static_cast<int>(k), c);
    return collect();
  }

 private:
  [[nodiscard]] std::size_t index(std::size_t k) const { return (k + start_) % reference_.size(); }
  /// How far outside a bend its vertex is wanted: half of what the edges beside it cut off, so that they may be longer.
  [[nodiscard]] double outward(std::size_t i) const {
    const GridPoint before = reference_[i == 0 ? reference_.size() - 1 : i - 1].at;
    const GridPoint p = reference_[i].at;
    const auto [nx, ny] = corners_[i].normal;
    const double aside =
        (nx * (static_cast<double>(p.x) - before.x) + ny * (static_cast<double>(p.y) - before.y)) / 16384;
    return std::clamp(aside / 8, -0.5 * rule_.tolerance, 0.5 * rule_.tolerance);
  }
  [[nodiscard]] double expectation(const MovingVertex& v) const {
    return v.no_history ? 0.0 : v.velocity / static_cast<double>(kDistanceUnit);
  }

  void find_hits() {
    std::size_t last = 0;
    bool known = false;
    double first_move_before = 0;
    for (std::size_t i = 0; i < reference_.size(); ++i) {
      const MovingVertex& v = reference_[i];
      const double expected = v.no_history ? first_move_before : expectation(v);
      Hit hit;
      const std::size_t size = target_.size();
      if (known && size > 3 * kNear)
        hit = target_.meet(v.at, corners_[i].normal, expected, last + size - kNear / 2, 2 * kNear);
      if (hit.at < 0 || std::abs(hit.distance - expected) > 4 * rule_.tolerance)
        hit = target_.meet(v.at, corners_[i].normal, expected, 0, size);
      if (hit.at < 0 || std::abs(hit.distance - expected) > kLargestMove) continue;
      hits_[i] = hit;
      last = static_cast<std::size_t>(hit.at);
      known = true;
      if (v.no_history) first_move_before = hit.distance;
    }
  }

  bool choose_start() {
    double best = kNever;
    for (std::size_t i = 0; i < hits_.size(); ++i) {
      if (hits_[i].at < 0) continue;
      const double gap = std::abs(hits_[i].distance - expectation(reference_[i]));
      if (gap < best) {
        best = gap;
        start_ = i;
      }
      if (gap <= 0.5 * rule_.tolerance) {
        start_ = i;
        break;
      }
    }
    return best < kNever;
  }

  void find_candidates() {
    ways_.assign(reference_.size(), {});
    start_at_ = hits_[start_].at;
    for (std::size_t k = 0; k < ways_.size(); ++k) {
      const std::size_t i = index(k);
      const Hit& hit = hits_[i];
      if (hit.at < 0) continue;
      double at = hit.at - start_at_;
      if (at < 0) at += static_cast<double>(target_.size());
      const double step = rule_.steps.residual;
      const double base = expectation(reference_[i]);
      const double wish = hit.distance + outward(i);
      const double wanted = (wish - base) / step;
      const auto nearest = static_cast<std::int32_t>(std::floor(wanted + 0.5));
      const std::int32_t toward = nearest > wanted ? nearest - 1 : nearest + 1;
      std::array<std::int32_t, 3> levels{nearest, toward, 0};
      const std::size_t count = reference_[i].no_history || nearest == 0 || toward == 0 ? 2 : 3;
      for (std::size_t l = 0; l < (k == 0 ? 1 : count); ++l) {
        Candidate c;
        c.level = levels[l];
        c.vertex = reference_[i];
        const std::int32_t expected = reference_[i].no_history ? 0 : reference_[i].velocity;
        if (!move_rule_.apply(c.vertex, corners_[i].normal, expected, c.level, rule_.most)) continue;
        c.error_square = square(c.vertex.at.x - hit.place.x) + square(c.vertex.at.y - hit.place.y);
        if (c.error_square > most_square_) continue;
        c.penalty = kTrackingWeight * square(base + c.level * step - wish) / most_square_;
        c.at = start_at_ + at;
        if (k == 0) {
          c.cost = 0;
          finish(c, reference_[i], 0, 0);
        }
        ways_[k].push_back(c);
      }
    }
  }

  /// Fills in residual and move of a candidate whose vertex before moved so.
  void finish(Candidate& c, const MovingVertex& source, std::int32_t move_before, std::int32_t) const {
    const std::int32_t unit = rule_.steps.residual * kDistanceUnit;
    const std::int32_t expected = move_rule_.expected(source, move_before);
    c.residual = source.no_history ? c.level - expected / unit : c.level;
    c.move = expected + c.residual * unit;
  }

  [[nodiscard]] double residual_cost(std::size_t k, std::int32_t residual, ResidualsBefore before) const {
    const ResidualContext near = ResidualContext::of(reference_[index(k)], reference_[index(k + 1)], before);
    if (near.is_after_large()) return models_.large.cost(zigzag(residual - near.guess()), near.large_size());
    double bits = cost_of(near.zero_models(models_).mean(), residual != 0 ? 1 : 0);
    if (residual == 0) return bits;
    bits += cost_of(near.sign_models(models_).mean(), residual < 0 ? 1 : 0);
    return bits + models_.size.cost(static_cast<std::uint32_t>(std::abs(residual)) - 1, near.size());
  }

  [[nodiscard]] double deletion_cost(int k, bool deleted_before, bool deleted) const {
    return cost_of(models_.deleted[deleted_before ? 1 : 0][corners_[index(static_cast<std::size_t>(k))].bend],
                   deleted ? 1 : 0);
  }

  /// Cheapest way from an earlier vertex to this one (k may be size(): the start again, a whole turn on).
  void reach(int k, Candidate& c) {
    const bool closing = k == static_cast<int>(ways_.size());
    const MovingVertex& source = reference_[index(static_cast<std::size_t>(k))];
    double dropped = 0;
    double run = 0;  // flags of the vertices j + 2 to k - 1
    for (int j = k - 1;
         j >= 0 && (j >= k - 1 - kMostDeleted || (c.cost == kNever && j >= k - 1 - kLongestGap && gap_trials_ > 0));
         --j) {
      // Vertices j + 1 to k - 1 are dropped; the flags behind j depend on j being kept.
      if (j < k - 2) run += deletion_cost(j + 2, true, true);
      dropped = run;
      if (j < k - 1) dropped += deletion_cost(j + 1, false, true);
      if (!closing) dropped += deletion_cost(k, k > j + 1, false);
      for (int b = 0; b < static_cast<int>(ways_[static_cast<std::size_t>(j)].size()); ++b) {
        const Candidate& before = ways_[static_cast<std::size_t>(j)][static_cast<std::size_t>(b)];
        if (before.cost + dropped >= c.cost || before.at >= c.at) continue;
        Candidate now = c;
        double cost = before.cost + dropped;
        if (!closing) {
          finish(now, source, before.move, before.residual);
          cost += c.penalty +
                  residual_cost(static_cast<std::size_t>(k), now.residual, {before.residual, before.residual_before});
        }
        if (cost >= c.cost) continue;
        if (k - j > kMostDeleted + 1 && gap_trials_-- <= 0) break;
        cost +=
            filler_.fill({before.vertex, c.vertex, before.at, c.at}, k - j <= 2 || k - j > kMostDeleted + 1, nullptr);
        if (cost >= c.cost) continue;
        c = now;
        c.residual_before = before.residual;
        c.cost = cost;
        c.from_vertex = j;
        c.from_candidate = b;
      }
    }
  }

  std::optional<RingFit> collect() {
    if (ways_[0].empty()) return std::nullopt;
    const int size = static_cast<int>(ways_.size());
    Candidate end = ways_[0][0];
    end.cost = kNever;
    end.at += static_cast<double>(target_.size());
    reach(size, end);
    if (end.cost == kNever) return std::nullopt;

    std::vector<std::pair<int, const Candidate*>> path;
    for (const Candidate* c = &end; c->from_vertex >= 0;) {
      path.emplace_back(c->from_vertex,
                        &ways_[static_cast<std::size_t>(c->from_vertex)][static_cast<std::size_t>(c->from_candidate)]);
      c = path.back().second;
    }
    std::reverse(path.begin(), path.end());
    RingFit fit;
    fit.plan.moves = true;
    fit.plan.start = static_cast<std::uint32_t>(start_);
    fit.plan.steps.assign(ways_.size(), {true, 0});
    Fill fills;
    for (std::size_t p = 0; p < path.size(); ++p) {
      const auto [k, c] = path[p];
      fit.plan.steps[static_cast<std::size_t>(k)] = {false, c->residual};
      fills.worst_square = std::max(fills.worst_square, c->error_square);
      fills.ring.push_back(c->vertex.at);
      const Candidate& next = p + 1 < path.size() ? *path[p + 1].second : end;
      // fill() sees velocities that are not settled for vertices without history; it uses positions only.
      if (filler_.fill({c->vertex, next.vertex, c->at, next.at}, true, &fills) == kNever) return std::nullopt;
    }
    fit.plan.fills = std::move(fills.nodes);
    fit.ring = std::move(fills.ring);
    fit.cost_bits = end.cost;
    fit.error = std::sqrt(fills.worst_square);
    if (fit.ring.size() < 3) return std::nullopt;
    return fit;
  }

  const MovingRing& reference_;
  Target target_;
  const CurveModels& models_;
  const FitRule& rule_;
  MoveRule move_rule_;
  EdgeFiller filler_;
  double most_square_;
  std::vector<Corner> corners_;
  std::vector<Hit> hits_;
  std::size_t start_ = 0;
  double start_at_ = 0;
  int gap_trials_ = kMostGapTrials;
  std::vector<std::vector<Candidate>> ways_;
};

}  // namespace

std::optional<RingFit> fit_motion(const MovingRing& reference, std::span<const Place> target, const CurveModels& models,
                                  const FitRule& rule) {
  if (reference.size() < 3 || target.size() < 3) return std::nullopt;
  auto fit = Motion{reference, target, models, rule}.fit();
  if (fit && (twice_area(fit->ring) > 0) != (twice_area(target) > 0)) return std::nullopt;
  return fit;
}

}  // namespace telefab::codec
