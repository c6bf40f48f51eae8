// SPDX-License-Identifier: GPL-3.0-or-later
#include "underside_watch.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {
namespace {

constexpr double kRim_px = 1.5;

bool within(const std::vector<double>& spans, double x) {
  return (std::upper_bound(spans.begin(), spans.end(), x) - spans.begin()) % 2 != 0;
}

}  // namespace

void UndersideWatch::descend(const DoseField& dose, const RingIndex& part, const RingIndex& joined) {
  // What ended with the layer above.
  const PixelBox box = above_.box();
  for (int y = box.y; y < box.y + box.height; ++y) {
    const auto before = above_.spans_at(y + 0.5);
    if (before.empty()) continue;
    const auto now = part.spans_at(y + 0.5);
    for (std::size_t i = 0; i + 1 < before.size(); i += 2) {
      const int last = static_cast<int>(std::floor(before[i + 1] - kRim_px - 0.5));
      for (int x = static_cast<int>(std::ceil(before[i] + kRim_px - 0.5)); x <= last; ++x) {
        const auto next = std::upper_bound(now.begin(), now.end(), x + 0.5);
        if ((next - now.begin()) % 2 != 0) {  // inside: on to the end of this span
          x = static_cast<int>(std::floor(*next - 0.5));
          continue;
        }
        const PixelPlace middle{x + 0.5, y + 0.5};
        if (above_.distance(middle, kRim_px) < kRim_px || part.distance(middle, kRim_px) < kRim_px ||
            joined.holds(middle, kRim_px))
          continue;
        open_.push_back({x, y, 0});
      }
    }
  }
  above_ = part;
  int row = -1 << 30;
  std::vector<double> part_row;
  const auto follow = [&](Column& column) {
    const PixelPlace middle{column.x + 0.5, column.y + 0.5};
    if (column.y != row) part_row = part.spans_at((row = column.y) + 0.5);
    const bool merged = within(part_row, middle.x_px);
    if (!merged && joined.holds(middle, kRim_px)) return false;  // a support takes over
    const double dose_here = dose.sample(middle).dose;
    const double depth = dose_here > 0 ? model_.penetration_mm * std::log(dose_here) / model_.layer_mm : -1;
    if (merged || depth < 1) {
      errors_.add(column.layers + (merged ? 0 : std::max(depth, column.layers > 0 ? 0.0 : -1.0)));
      return false;
    }
    ++column.layers;
    return true;
  };
  std::erase_if(open_, [&](Column& column) { return !follow(column); });
}

void UndersideWatch::finish() {
  for (const Column& column : open_) errors_.add(column.layers);
  open_.clear();
}

}  // namespace telefab::fab
