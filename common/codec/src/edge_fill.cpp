// SPDX-License-Identifier: GPL-3.0-or-later
#include "edge_fill.hpp"

#include <algorithm>

namespace telefab::codec {
namespace {

double square_distance_to_chord(Place p, Place a, Place b) {
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  const double length = dx * dx + dy * dy;
  const double along = length > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / length, 0.0, 1.0) : 0.0;
  return square(p.x - a.x - along * dx) + square(p.y - a.y - along * dy);
}

}  // namespace

Hit Target::meet(GridPoint p, Normal normal, double expected, std::size_t from, std::size_t count) const {
  const double nx = normal.x / 16384.0;
  const double ny = normal.y / 16384.0;
  Hit best;
  double best_gap = kNever;
  std::size_t s = from % size();
  Place a = ring_[s];
  double side_a = nx * (a.y - p.y) - ny * (a.x - p.x);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t e = s + 1 == size() ? 0 : s + 1;
    const Place b = ring_[e];
    const double side_b = nx * (b.y - p.y) - ny * (b.x - p.x);
    if (side_a < 0 && side_b >= 0) {
      const double share = side_a / (side_a - side_b);
      const Place q{a.x + share * (b.x - a.x), a.y + share * (b.y - a.y)};
      const double d = nx * (q.x - p.x) + ny * (q.y - p.y);
      if (std::abs(d - expected) < best_gap) {
        best_gap = std::abs(d - expected);
        best = {static_cast<double>(s) + std::min(share, 0.999999999), d, q};
      }
    }
    s = e;
    a = b;
    side_a = side_b;
  }
  return best;
}

double Target::bulge(GridPoint from, GridPoint to, double at, double end, double most_square) const {
  const Place a = place_of(from);
  const Place b = place_of(to);
  const auto first = static_cast<std::size_t>(std::floor(at)) + 1;
  const auto last = static_cast<std::size_t>(std::ceil(end));  // exclusive
  double worst = 0;
  for (std::size_t i = first; i < last; ++i) {
    const double d = square_distance_to_chord(ring_[i % size()], a, b);
    if (d > most_square) return kNever;
    worst = std::max(worst, d);
  }
  return worst;
}

double EdgeFiller::fill(const Edge& edge, const FillContext& context, bool may_split, Fill* out) const {
  const auto& [a, b, at, end] = edge;
  if (a.at == b.at || end <= at) return kNever;
  const double bulge = target_.bulge(a.at, b.at, at, end, most_square_);
  const auto& split = models_.split[context.split(a.at, b.at)];
  if (bulge < kNever) {
    if (out) {
      if (context.depth <= kDeepestFill) out->nodes.push_back({});
      out->worst_square = std::max(out->worst_square, bulge);
    }
    return context.depth <= kDeepestFill ? cost_of(split, 0) : 0;
  }
  if (!may_split || context.depth > kDeepestFill) return kNever;
  const auto first = static_cast<std::size_t>(std::floor(at));
  const auto last = static_cast<std::size_t>(std::floor(end));
  const Hit hit = target_.meet(middle(a.at, b.at), normal_of(a.at, b.at),
                               static_cast<double>(context.guess()) * rule_.steps.residual, first, last - first + 1);
  if (hit.at < 0) return kNever;
  double meet = hit.at;
  while (meet < at) meet += static_cast<double>(target_.size());
  if (meet >= end) return kNever;
  const auto offset = static_cast<std::int32_t>(std::floor(hit.distance / rule_.steps.residual + 0.5));
  MovingVertex between;
  if (!make_between(a, b, offset, rule_.steps.residual, rule_.most, between)) return kNever;
  const double error = square(between.at.x - hit.place.x) + square(between.at.y - hit.place.y);
  if (error > most_square_) return kNever;
  const double own = cost_of(split, 1) + models_.offset.cost(zigzag(offset - context.guess()), context.offset());
  if (out) {
    out->nodes.push_back({true, offset});
    out->worst_square = std::max(out->worst_square, error);
  }
  const double left = fill({a, between, at, meet}, context.child(offset), true, out);
  if (left == kNever) return kNever;
  if (out) out->ring.push_back(between.at);
  const double right = fill({between, b, meet, end}, context.child(offset), true, out);
  return own + left + right;
}

}  // namespace telefab::codec
