// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/carry/carry_watch.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint8_t kHalf = 128;

/// Pixels of either.
PixelRuns united(const PixelRuns& a, const PixelRuns& b) {
  PixelRuns out;
  for (std::uint32_t y = 0; y < a.rows(); ++y) {
    out.begin_row();
    const auto p = a.row(y), q = b.row(y);
    PixelRun open;
    const auto take = [&](const PixelRun& run) {
      if (open.width() > 0 && run.first <= open.behind) {
        open.behind = std::max(open.behind, run.behind);
        return;
      }
      if (open.width() > 0) out.add(open);
      open = run;
    };
    std::size_t i = 0, j = 0;
    while (i < p.size() || j < q.size()) {
      const bool is_a = j == q.size() || (i < p.size() && p[i].first <= q[j].first);
      take(is_a ? p[i++] : q[j++]);
    }
    if (open.width() > 0) out.add(open);
  }
  return out;
}

}  // namespace

LayerRuns firm_pixels(const MaskView& mask, const LayerRuns& solid) {
  const PixelRuns all = solid.rows();
  const PixelRuns lit = common(LayerRuns::from_mask(mask, kHalf).rows(), all);
  return LayerRuns::from_rows(united(lit, shrunk(all, 1)), solid.size());
}

}  // namespace telefab::fab
