// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/mask/pixel_runs.hpp>

namespace telefab::fab {

PixelRuns common(const PixelRuns& a, const PixelRuns& b, std::uint32_t rows_up) {
  PixelRuns both;
  for (std::uint32_t y = 0; y < a.rows(); ++y) {
    both.begin_row();
    if (y + rows_up >= b.rows()) continue;
    const auto p = a.row(y), q = b.row(y + rows_up);
    for (std::size_t i = 0, j = 0; i < p.size() && j < q.size();) {
      const std::int32_t first = std::max(p[i].first, q[j].first), behind = std::min(p[i].behind, q[j].behind);
      if (first < behind) both.add({first, behind});
      if (p[i].behind < q[j].behind)
        ++i;
      else
        ++j;
    }
  }
  return both;
}

PixelRuns without(const PixelRuns& a, const PixelRuns& b) {
  PixelRuns rest;
  for (std::uint32_t y = 0; y < a.rows(); ++y) {
    rest.begin_row();
    const auto cut = b.row(y);
    std::size_t j = 0;
    for (const PixelRun& run : a.row(y)) {
      std::int32_t first = run.first;
      while (j < cut.size() && cut[j].behind <= first) ++j;
      for (std::size_t k = j; k < cut.size() && cut[k].first < run.behind; ++k) {
        if (cut[k].first > first) rest.add({first, cut[k].first});
        first = cut[k].behind;
      }
      if (first < run.behind) rest.add({first, run.behind});
    }
  }
  return rest;
}

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

PixelRuns shrunk(const PixelRuns& set, std::uint32_t by) {
  const auto side = static_cast<std::int32_t>(by);
  PixelRuns narrow;
  for (std::uint32_t y = 0; y < set.rows(); ++y) {
    narrow.begin_row();
    for (const PixelRun& run : set.row(y))
      if (run.behind - run.first > 2 * side) narrow.add({run.first + side, run.behind - side});
  }
  // What 1, 2, 4, .. rows from each row on have in common, and from that 2 by + 1 of them.
  const std::uint32_t window = 2 * by + 1;
  std::uint32_t reach = 1;
  for (; 2 * reach <= window; reach *= 2) narrow = common(narrow, narrow, reach);
  const PixelRuns from_first = common(narrow, narrow, window - reach);
  PixelRuns out;
  for (std::uint32_t y = 0; y < set.rows(); ++y) {
    out.begin_row();
    if (y < by) continue;
    for (const PixelRun& run : from_first.row(y - by)) out.add(run);
  }
  return out;
}

}  // namespace telefab::fab
