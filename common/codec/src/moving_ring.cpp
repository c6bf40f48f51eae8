// SPDX-License-Identifier: GPL-3.0-or-later
#include "moving_ring.hpp"

#include <algorithm>
#include <cmath>

#include "range_coder.hpp"

namespace telefab::codec {
namespace {

constexpr std::int32_t kNormalUnit = 16384;

double distance(GridPoint a, GridPoint b) {
  const double dx = static_cast<double>(b.x) - a.x;
  const double dy = static_cast<double>(b.y) - a.y;
  return std::sqrt(dx * dx + dy * dy);
}

/// Each value goes `eighths` of the way to the mean of its two neighbours'.
void smooth(MovingRing& ring, std::int32_t MovingVertex::*value, std::int32_t eighths) {
  const std::int32_t first = ring.front().*value;
  std::int32_t before = ring.back().*value;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const std::int32_t own = ring[i].*value;
    const std::int32_t after = i + 1 == ring.size() ? first : ring[i + 1].*value;
    ring[i].*value = own + ((before + after) / 2 - own) * eighths / 8;
    before = own;
  }
}

bool inside(GridPoint p, GridPoint most) { return p.x >= 0 && p.y >= 0 && p.x <= most.x && p.y <= most.y; }

}  // namespace

Normal normal_of(GridPoint from, GridPoint to) {
  const double length = distance(from, to);
  if (length == 0) return {};
  const auto part = [&](double d) { return static_cast<std::int32_t>(std::floor(d * kNormalUnit / length + 0.5)); };
  return {part(static_cast<double>(to.y) - from.y), part(static_cast<double>(from.x) - to.x)};
}

std::vector<Corner> corners_of(std::span<const MovingVertex> ring) {
  std::vector<Corner> corners(ring.size());
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const GridPoint before = ring[i == 0 ? ring.size() - 1 : i - 1].at;
    const GridPoint after = ring[i + 1 == ring.size() ? 0 : i + 1].at;
    const Normal n = normal_of(before, after);
    const GridPoint p = ring[i].at;
    const std::int64_t aside =
        std::int64_t{n.x} * (std::int64_t{p.x} - before.x) + std::int64_t{n.y} * (std::int64_t{p.y} - before.y);
    const std::int64_t half_steps = std::min<std::int64_t>(std::abs(aside) / (kNormalUnit / 2), 2047);
    corners[i] = {n, bit_length(static_cast<std::uint32_t>(half_steps))};
  }
  return corners;
}

GridPoint moved(GridPoint p, Normal normal, std::int32_t distance) {
  constexpr std::int64_t unit = std::int64_t{kNormalUnit} * kDistanceUnit;
  const auto go = [&](std::int32_t from, std::int32_t n) {
    const std::int64_t by = (std::int64_t{n} * distance + unit / 2);
    return static_cast<std::int32_t>(from + (by >= 0 ? by / unit : -((-by + unit - 1) / unit)));
  };
  return {go(p.x, normal.x), go(p.y, normal.y)};
}

unsigned length_class(GridPoint a, GridPoint b) {
  const std::int64_t dx = std::int64_t{b.x} - a.x;
  const std::int64_t dy = std::int64_t{b.y} - a.y;
  const auto square = static_cast<std::uint64_t>(dx * dx + dy * dy);
  return std::min(square >> 32U ? 31U : bit_length(static_cast<std::uint32_t>(square)), 31U);
}

bool MoveRule::apply(MovingVertex& v, Normal normal, std::int32_t expected_move, std::int32_t residual,
                     GridPoint most) const {
  const std::int64_t extra = std::int64_t{residual} * step * kDistanceUnit;
  const std::int64_t move = expected_move + extra;
  if (move < -kMaxDistance || move > kMaxDistance) return false;
  v.at = moved(v.at, normal, static_cast<std::int32_t>(move));
  if (!inside(v.at, most)) return false;
  v.change = v.no_history ? 0 : static_cast<std::int32_t>((v.change * std::int64_t{60} + extra * 8) / 64);
  v.velocity = static_cast<std::int32_t>(std::clamp<std::int64_t>(move + v.change, -kMaxDistance, kMaxDistance));
  v.last = v.no_history ? 0 : std::clamp(residual, -2, 2);
  v.no_history = false;
  return true;
}

void smooth_motion(MovingRing& ring) {
  if (ring.empty()) return;
  smooth(ring, &MovingVertex::velocity, 7);
  smooth(ring, &MovingVertex::velocity, 4);
  smooth(ring, &MovingVertex::change, 7);
}

bool make_between(const MovingVertex& a, const MovingVertex& b, std::int32_t offset, std::int32_t step, GridPoint most,
                  MovingVertex& made) {
  const std::int64_t aside = std::int64_t{offset} * step * kDistanceUnit;
  if (aside < -kMaxDistance || aside > kMaxDistance) return false;
  made.at = moved(middle(a.at, b.at), normal_of(a.at, b.at), static_cast<std::int32_t>(aside));
  made.velocity = (a.velocity + b.velocity) / 2;
  made.change = (a.change + b.change) / 2;
  made.last = 0;
  made.no_history = a.no_history && b.no_history;
  return inside(made.at, most) && !(made.at == a.at) && !(made.at == b.at);
}

}  // namespace telefab::codec
