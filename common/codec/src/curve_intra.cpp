// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include "edge_fill.hpp"

// Intra rings: by longest chords, or by few corners and the vertices over their edges.
namespace telefab::codec {
namespace {

constexpr double kBitsAnyChord = 18;   ///< a vertex of longest chords
constexpr double kBitsACorner = 22;    ///< a corner
constexpr double kBitsARing = 24;      ///< its first vertex and its size
constexpr std::size_t kPatience = 6;   ///< target vertices tried beyond one that ends no chord
constexpr std::size_t kLeastSpan = 8;  ///< target vertices; shorter spans get no further corner

template <class Point>
double twice_area_of(std::span<const Point> ring) {
  double sum = 0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Point& a = ring[i];
    const Point& b = ring[i + 1 == ring.size() ? 0 : i + 1];
    const double ox = static_cast<double>(ring[0].x);
    const double oy = static_cast<double>(ring[0].y);
    sum += (a.x - ox) * (b.y - oy) - (b.x - ox) * (a.y - oy);
  }
  return sum;
}

/// The coarser lattice of intra rings.
class Coarse {
 public:
  explicit Coarse(const FitRule& rule) : step_{rule.steps.intra}, most_{rule.most.x / step_, rule.most.y / step_} {}
  [[nodiscard]] GridPoint snap(Place p) const { return {go(p.x, most_.x), go(p.y, most_.y)}; }
  [[nodiscard]] GridPoint fine(GridPoint p) const { return {p.x * step_, p.y * step_}; }

 private:
  [[nodiscard]] std::int32_t go(double v, std::int32_t limit) const {
    return static_cast<std::int32_t>(std::clamp(std::floor(v / step_ + 0.5), 0.0, static_cast<double>(limit)));
  }
  std::int32_t step_;
  GridPoint most_;
};

bool keeps_area(const std::vector<GridPoint>& ring, std::span<const Place> target) {
  const double area = twice_area(std::span<const GridPoint>{ring});
  return ring.size() >= 3 && area != 0 && (area > 0) == (twice_area(target) > 0);
}

std::optional<RingFit> longest_chords(std::span<const Place> target, const FitRule& rule, bool all) {
  const Coarse coarse{rule};
  const double most_square = square(rule.tolerance);
  const Target ring{target};
  RingFit fit;
  double worst = 0;
  const std::size_t n = target.size();
  for (std::size_t i = 0; i < n;) {
    const GridPoint here = coarse.snap(target[i]);
    const GridPoint from = coarse.fine(here);
    worst = std::max(worst, square(from.x - target[i].x) + square(from.y - target[i].y));
    if (fit.plan.intra.empty() || !(fit.plan.intra.back() == here)) fit.plan.intra.push_back(here);
    std::size_t next = i + 1;
    if (!all) {
      double bulge = 0;
      for (std::size_t j = i + 2; j <= n && j <= next + kPatience; ++j) {
        const GridPoint there = coarse.snap(target[j % n]);
        if (there == here) continue;
        const double b =
            ring.bulge(from, coarse.fine(there), static_cast<double>(i), static_cast<double>(j), most_square);
        if (b == kNever) continue;
        next = j;
        bulge = b;
      }
      worst = std::max(worst, bulge);
    }
    i = next;
  }
  auto& made = fit.plan.intra;
  while (made.size() > 1 && made.back() == made.front()) made.pop_back();
  for (const GridPoint p : made) fit.ring.push_back(coarse.fine(p));
  if (!keeps_area(fit.ring, target)) return std::nullopt;
  fit.error = std::sqrt(worst);
  fit.cost_bits = kBitsAnyChord * static_cast<double>(made.size()) + kBitsARing;
  return fit;
}

/// Corners found by halving: a span of the target is one edge with what lies over it, or two spans.
class Corners {
 public:
  Corners(std::span<const Place> target, const CurveModels& models, const FitRule& rule)
      : target_{target}, ring_{target}, coarse_{rule}, filler_{ring_, models.fill[1], rule} {}

  std::optional<RingFit> fit() {
    RingFit fit;
    fit.plan.filled = true;
    fit.cost_bits = kBitsARing;
    const std::size_t n = target_.size();
    std::vector<std::size_t> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      const double cost = span(k * n / 3, (k + 1) * n / 3, corners);
      if (cost == kNever) return std::nullopt;
      fit.cost_bits += cost + kBitsACorner;
    }
    Fill fills;
    for (std::size_t c = 0; c < corners.size(); ++c) {
      const std::size_t i = corners[c];
      const std::size_t j = c + 1 < corners.size() ? corners[c + 1] : n;
      const GridPoint here = coarse_.snap(target_[i]);
      const GridPoint from = coarse_.fine(here);
      fit.plan.intra.push_back(here);
      fills.ring.push_back(from);
      fills.worst_square = std::max(fills.worst_square, square(from.x - target_[i].x) + square(from.y - target_[i].y));
      if (filler_.fill(edge(i, j), true, &fills) == kNever) return std::nullopt;
    }
    fit.plan.fills = std::move(fills.nodes);
    fit.ring = std::move(fills.ring);
    fit.error = std::sqrt(fills.worst_square);
    if (!keeps_area(fit.ring, target_)) return std::nullopt;
    return fit;
  }

 private:
  [[nodiscard]] MovingVertex corner(std::size_t i) const {
    return {coarse_.fine(coarse_.snap(target_[i % target_.size()]))};
  }
  [[nodiscard]] Edge edge(std::size_t i, std::size_t j) const {
    return {corner(i), corner(j), static_cast<double>(i), static_cast<double>(j)};
  }

  /// Adds the corners of [i, j) and returns their cost but for that of i.
  double span(std::size_t i, std::size_t j, std::vector<std::size_t>& corners) {
    const double whole = j > i ? filler_.fill(edge(i, j), true, nullptr) : kNever;
    std::vector<std::size_t> halved;
    double halves = kNever;
    if (whole > kBitsACorner && (j - i >= kLeastSpan || (whole == kNever && j - i >= 2))) {
      const std::size_t m = (i + j) / 2;
      halves = span(i, m, halved) + kBitsACorner;
      if (halves < whole) halves += span(m, j, halved);
    }
    if (halves < whole)
      corners.insert(corners.end(), halved.begin(), halved.end());
    else
      corners.push_back(i);
    return std::min(whole, halves);
  }

  std::span<const Place> target_;
  Target ring_;
  Coarse coarse_;
  EdgeFiller filler_;
};

}  // namespace

double twice_area(std::span<const GridPoint> ring) { return twice_area_of(ring); }
double twice_area(std::span<const Place> ring) { return twice_area_of(ring); }

std::optional<RingFit> fit_intra(std::span<const Place> target, const CurveModels& models, const FitRule& rule,
                                 bool all) {
  if (target.size() < 3) return std::nullopt;
  if (!all) {
    auto corners = Corners{target, models, rule}.fit();
    auto chords = longest_chords(target, rule, false);
    if (corners && (!chords || corners->cost_bits < chords->cost_bits)) return corners;
    if (chords) return chords;
  }
  return longest_chords(target, rule, true);
}

}  // namespace telefab::codec
