// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <limits>

#include "curve_fit.hpp"

// What the searches of the encoder share: the ring to be coded, and the cheapest vertices over one edge.
namespace telefab::codec {

inline constexpr double kNever = std::numeric_limits<double>::infinity();

[[nodiscard]] inline Place place_of(GridPoint p) { return {static_cast<double>(p.x), static_cast<double>(p.y)}; }
[[nodiscard]] inline double square(double v) { return v * v; }

/// Where a line meets the target: `at` is segment number + share, `distance` along the line's direction.
struct Hit {
  double at = -1;
  double distance = 0;
  Place place;
};

/// The ring to be coded.
class Target {
 public:
  explicit Target(std::span<const Place> ring) : ring_{ring} {}
  [[nodiscard]] std::size_t size() const { return ring_.size(); }

  /// Where the line from p along the normal crosses the ring from right to left, nearest to `expected`.
  [[nodiscard]] Hit meet(GridPoint p, Normal normal, double expected, std::size_t from, std::size_t count) const;

  /// Largest square distance of the vertices strictly between two places to a chord; kNever as soon as it is above.
  [[nodiscard]] double bulge(GridPoint from, GridPoint to, double at, double end, double most_square) const;

 private:
  std::span<const Place> ring_;
};

struct Fill {
  std::vector<FillNode> nodes;
  std::vector<GridPoint> ring;
  double worst_square = 0;
};

/// An edge between two kept vertices, and the part of the target it stands for.
struct Edge {
  MovingVertex a;
  MovingVertex b;
  double at = 0;
  double end = 0;
};

/// Finds the vertices over an edge that keep it within the tolerance.
class EdgeFiller {
 public:
  EdgeFiller(const Target& target, const FillModels& models, const FitRule& rule)
      : target_{target}, models_{models}, rule_{rule}, most_square_{square(rule.tolerance)} {}

  /// Bits it costs, and with `out` the way itself; kNever where it cannot be within the tolerance.
  double fill(const Edge& edge, bool may_split, Fill* out) const { return fill(edge, FillContext{}, may_split, out); }

 private:
  double fill(const Edge& edge, const FillContext& context, bool may_split, Fill* out) const;

  const Target& target_;
  const FillModels& models_;
  const FitRule& rule_;
  double most_square_;
};

}  // namespace telefab::codec
