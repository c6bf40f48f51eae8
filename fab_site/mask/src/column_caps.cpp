// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/fab/mask/column_caps.hpp>

#include "cover_cells.hpp"

namespace telefab::fab {
namespace {

constexpr int kSolidFrom = 32;
constexpr int kMostReach = 64;

/// Factors of all layers of a column with an underside: dark from below until the rest cures to the underside at most.
std::vector<double> factors_of(int layers, const MaskLight& light) {
  std::vector<double> factors(static_cast<std::size_t>(layers), 1.0);
  const double per_layer = light.layer_mm / light.penetration_mm;
  double rest = 0;
  for (int i = layers - 1; i >= 0; --i) {
    const double reaches = light.white * std::exp(-(i + 1) * per_layer);
    factors[static_cast<std::size_t>(i)] = std::clamp((1 - rest) / reaches, 0.0, 1.0);
    rest += factors[static_cast<std::size_t>(i)] * reaches;
  }
  return factors;
}

}  // namespace

CapTable::CapTable(const MaskLight& light, int most_above) : most_above_{std::clamp(most_above, 0, kMostReach)} {
  for (int below = 0; below < kMostReach; ++below) {
    std::vector<std::uint8_t> row;
    for (int above = 0; above <= most_above_; ++above)
      row.push_back(static_cast<std::uint8_t>(
          std::lround(255 * factors_of(below + 1 + above, light)[static_cast<std::size_t>(below)])));
    if (std::all_of(row.begin(), row.end(), [](std::uint8_t cap) { return cap == 255; })) break;
    caps_.insert(caps_.end(), row.begin(), row.end());
    ++reach_;
  }
}

std::uint8_t CapTable::cap(int below, int above) const {
  if (below >= reach_) return 255;
  return caps_[static_cast<std::size_t>(below * (most_above_ + 1) + std::min(above, most_above_))];
}

SolidRows::SolidRows(std::span<const Contour> part, std::span<const Contour> supports, const MaskFrame& frame) {
  const CoverCells a{part, frame}, b{supports, frame};
  const std::size_t width = frame.size.width_px;
  std::vector<std::uint8_t> row(width), other(width);
  const auto add = [width](PixelRuns& to, const std::vector<std::uint8_t>& cover) {
    for (std::size_t x = 0; x < width;) {
      while (x < width && cover[x] < kSolidFrom) ++x;
      const std::size_t first = x;
      while (x < width && cover[x] >= kSolidFrom) ++x;
      if (x > first) to.add({static_cast<std::int32_t>(first), static_cast<std::int32_t>(x)});
    }
  };
  for (std::uint32_t y = 0; y < frame.size.height_px; ++y) {
    solid_.begin_row();
    supports_.begin_row();
    const bool any = !a.empty(y), more = !b.empty(y);
    if (!any && !more) continue;
    a.fill(y, row.data());
    if (more) {
      b.fill(y, other.data());
      add(supports_, other);
      for (std::size_t x = 0; x < width; ++x) row[x] = std::max(row[x], other[x]);
    }
    add(solid_, row);
  }
}

namespace {

constexpr std::uint8_t kHeld = 255;  // a count of solid layers below that no gap ends; a pixel without cap
constexpr std::uint8_t kDark = 1;    // solid, but never lit

/// Calls `each` with the columns of a run that lie between `from` and `until`, of every such run.
template <class Each>
void visit(std::span<const PixelRun> runs, const PixelRun& span, const Each& each) {
  auto run = std::ranges::upper_bound(runs, span.first, {}, &PixelRun::behind);
  for (; run != runs.end() && run->first < span.behind; ++run)
    each(std::max(run->first, span.first), std::min(run->behind, span.behind));
}

/// Solid layers of the column of every pixel of a span, nearest first: a count that stops growing at the first gap.
void count_solid(const std::vector<const SolidRows*>& layers, std::uint32_t y, const PixelRun& span, bool supports_hold,
                 std::vector<std::uint8_t>& counts) {
  counts.assign(static_cast<std::size_t>(span.width()), 0);
  const auto of = [&](std::int32_t x) -> std::uint8_t& { return counts[static_cast<std::size_t>(x - span.first)]; };
  for (std::size_t k = 0; k < layers.size(); ++k) {
    if (supports_hold)
      visit(layers[k]->support_row(y), span, [&](std::int32_t first, std::int32_t behind) {
        for (std::int32_t x = first; x < behind; ++x) of(x) = of(x) == k ? kHeld : of(x);
      });
    visit(layers[k]->row(y), span, [&](std::int32_t first, std::int32_t behind) {
      for (std::int32_t x = first; x < behind; ++x) of(x) = static_cast<std::uint8_t>(of(x) + (of(x) == k));
    });
  }
}

/// What is solid here and not in all of the layers below that count: a column of it may be capped.
PixelRuns perhaps_capped(const SolidRows& here, const std::vector<const SolidRows*>& below, std::size_t reach,
                         bool grounded) {
  if (below.size() < reach && !grounded) return here.solid();
  PixelRuns held = here.solid();
  for (std::size_t k = 0; k < std::min(reach, below.size()); ++k) held = common(held, below[k]->solid());
  return without(here.solid(), held);
}

}  // namespace

LayerCaps::LayerCaps(const CapTable& table, const SolidRows& here, const std::vector<const SolidRows*>& below,
                     const std::vector<const SolidRows*>& above, bool on_platform) {
  const auto reach = static_cast<std::size_t>(table.reach());
  if (reach == 0 || (below.empty() && on_platform)) return;
  const bool grounded = on_platform && below.size() < reach;
  const PixelRuns doubtful = perhaps_capped(here, below, reach, grounded);
  // The box around them, with the rows beside, by which they may be held.
  std::uint32_t behind = 0;
  for (std::uint32_t y = 0; y < doubtful.rows(); ++y) {
    if (doubtful.row(y).empty()) continue;
    if (behind == 0) front_ = y > 0 ? y - 1 : 0;
    behind = std::min(y + 2, here.rows());
  }
  if (behind == 0) return;
  std::int32_t from = std::numeric_limits<std::int32_t>::max(), until = 0;
  for (std::uint32_t y = front_; y < behind; ++y)
    if (const auto solid = here.row(y); !solid.empty()) {
      from = std::min(from, solid.front().first);
      until = std::max(until, solid.back().behind);
    }
  from_ = static_cast<std::size_t>(from);
  width_ = static_cast<std::size_t>(until - from);
  capped_.assign(behind - front_, 0);
  caps_.assign(width_ * capped_.size(), 0);
  held_.assign(caps_.size(), 0);
  std::vector<std::uint8_t> under, over;
  for (std::uint32_t y = front_; y < behind; ++y) {
    std::uint8_t* const caps = caps_.data() + (y - front_) * width_;
    std::uint8_t* const held = held_.data() + (y - front_) * width_;
    for (const PixelRun& run : here.row(y))
      for (auto* each : {caps, held}) std::fill(each + (run.first - from), each + (run.behind - from), kHeld);
    for (const PixelRun& span : doubtful.row(y)) {
      count_solid(below, y, span, true, under);
      visit(here.support_row(y), span, [&](std::int32_t first, std::int32_t last) {
        std::fill(under.begin() + (first - span.first), under.begin() + (last - span.first), kHeld);
      });
      const auto is_held = [&](std::uint8_t count) { return count >= reach || (grounded && count == below.size()); };
      if (std::ranges::all_of(under, is_held)) continue;
      capped_[y - front_] = 1;
      count_solid(above, y, span, false, over);
      for (std::int32_t x = span.first; x < span.behind; ++x) {
        const auto at = static_cast<std::size_t>(x - span.first);
        if (is_held(under[at])) continue;
        caps[x - from] = table.cap(under[at], over[at]);
        held[x - from] = caps[x - from] == 0 ? kDark : 0;
      }
    }
  }
  darken_what_floats();
}

void LayerCaps::darken_what_floats() {
  // The best way to a held pixel for every capped one, brightest first.
  std::array<std::vector<std::uint32_t>, 256> by_light;
  const auto rows = capped_.size();
  const auto each_neighbour = [&](std::size_t at, auto&& visit) {
    const std::size_t y = at / width_, x = at % width_;
    for (std::size_t j = y > 0 ? y - 1 : 0; j <= std::min(y + 1, rows - 1); ++j)
      for (std::size_t i = x > 0 ? x - 1 : 0; i <= std::min(x + 1, width_ - 1); ++i) visit(j * width_ + i);
  };
  std::vector<std::uint8_t>& best = held_;
  std::vector<std::uint32_t> capped;
  for (std::size_t y = 0; y < rows; ++y) {
    if (!capped_[y]) continue;
    for (std::size_t at = y * width_; at < (y + 1) * width_; ++at)
      if (caps_[at] != 0 && held_[at] == 0) capped.push_back(static_cast<std::uint32_t>(at));
  }
  for (const std::uint32_t at : capped) {
    bool beside = false;
    each_neighbour(at, [&](std::size_t n) { beside |= held_[n] == 255; });
    if (beside) by_light[caps_[at]].push_back(at);
  }
  for (std::size_t light = 256; light-- > 1;)
    for (const std::uint32_t at : by_light[light]) best[at] = static_cast<std::uint8_t>(light);
  for (std::size_t light = 256; light-- > 1;)
    for (std::size_t i = 0; i < by_light[light].size(); ++i) {
      const std::uint32_t at = by_light[light][i];
      if (best[at] != light) continue;
      each_neighbour(at, [&](std::size_t n) {
        const auto through = static_cast<std::uint8_t>(std::min<std::size_t>(light, caps_[n]));
        if (through <= best[n]) return;
        best[n] = through;
        by_light[through].push_back(static_cast<std::uint32_t>(n));
      });
    }
  for (std::size_t y = 0; y < rows; ++y)
    for (std::size_t at = y * width_; at < (y + 1) * width_ && capped_[y]; ++at)
      if (caps_[at] == 0 && held_[at] != kDark) caps_[at] = 255;
  // What is three pixels wide somewhere cures well, and the body cures to it with the layers that follow: it stays lit.
  enum : std::uint8_t { kCalm, kFloats, kStays };
  std::vector<std::uint8_t> state(caps_.size(), kCalm);
  for (const std::uint32_t at : capped)
    if (caps_[at] > best[at]) state[at] = kFloats;
  std::vector<std::uint32_t> stays;
  for (const std::uint32_t at : capped) {
    int around = 0;
    if (state[at] != kCalm) each_neighbour(at, [&](std::size_t n) { around += state[n] != kCalm; });
    if (around == 9) stays.push_back(at);
  }
  for (const std::uint32_t at : stays) state[at] = kStays;
  while (!stays.empty()) {
    const std::uint32_t at = stays.back();
    stays.pop_back();
    each_neighbour(at, [&](std::size_t n) {
      if (state[n] != kFloats) return;
      state[n] = kStays;
      stays.push_back(static_cast<std::uint32_t>(n));
    });
  }
  for (const std::uint32_t at : capped)
    if (state[at] == kFloats) caps_[at] = best[at];
  held_.clear();
  held_.shrink_to_fit();
}

bool LayerCaps::fill(std::uint32_t y, std::span<std::uint8_t> row) const {
  if (y < front_ || y - front_ >= capped_.size() || !capped_[y - front_]) return false;
  std::fill(row.begin(), row.end(), std::uint8_t{255});
  const auto caps = caps_.begin() + static_cast<std::ptrdiff_t>((y - front_) * width_);
  std::copy(caps, caps + static_cast<std::ptrdiff_t>(width_), row.begin() + static_cast<std::ptrdiff_t>(from_));
  return true;
}

}  // namespace telefab::fab
