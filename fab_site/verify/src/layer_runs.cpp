// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/base/disjoint_sets.hpp>
#include <telefab/fab/verify/layer_runs.hpp>

namespace telefab::fab {

namespace {

/// The first column from x on whose grey is at or above the level (or below it); `width` where there is none.
template <bool kSolid>
std::int32_t next_where(const std::uint8_t* row, std::int32_t x, std::int32_t width, std::uint8_t level) {
  constexpr std::int32_t kBlock = 32;  // no branch within it
  const auto is_it = [level](std::uint8_t grey) { return (grey >= level) == kSolid; };
  while (x + kBlock <= width) {
    std::uint8_t any = 0;
    for (std::int32_t i = 0; i < kBlock; ++i) any |= static_cast<std::uint8_t>(is_it(row[x + i]));
    if (any) break;
    x += kBlock;
  }
  while (x < width && !is_it(row[x])) ++x;
  return x;
}

}  // namespace

LayerRuns LayerRuns::from_mask(const MaskView& mask, std::uint8_t level) {
  LayerRuns out;
  out.size_ = mask.size;
  const auto width = static_cast<std::int32_t>(mask.size.width_px);
  out.starts_.reserve(mask.size.height_px + 1);
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y) {
    out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
    // Row 0 of a mask is the back of the platform.
    const std::uint8_t* row =
        mask.rows.data() + static_cast<std::size_t>(mask.size.height_px - 1 - y) * mask.size.width_px;
    for (std::int32_t x = 0; x < width;) {
      x = next_where<true>(row, x, width, level);
      if (x == width) break;
      const std::int32_t first = x;
      x = next_where<false>(row, x, width, level);
      out.runs_.push_back({first, x});
    }
  }
  out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
  return out;
}

LayerRuns LayerRuns::from_rows(const PixelRuns& rows, PixelSize size) {
  LayerRuns out;
  out.size_ = size;
  for (std::uint32_t y = 0; y < size.height_px; ++y) {
    out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
    const auto runs = rows.row(y);
    out.runs_.insert(out.runs_.end(), runs.begin(), runs.end());
  }
  out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
  return out;
}

PixelRuns LayerRuns::rows() const {
  PixelRuns out;
  for (std::uint32_t y = 0; y < size_.height_px; ++y) {
    out.begin_row();
    for (const PixelRun& run : row(y)) out.add(run);
  }
  return out;
}

LayerRuns LayerRuns::some_of(const LayerRuns& layer, const std::vector<char>& keep) {
  LayerRuns out;
  out.size_ = layer.size_;
  for (std::uint32_t y = 0; y < layer.size_.height_px; ++y) {
    out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
    for (std::uint32_t i = layer.starts_[y]; i < layer.starts_[y + 1]; ++i)
      if (keep[i]) out.runs_.push_back(layer.runs_[i]);
  }
  out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
  return out;
}

bool LayerRuns::contains(std::int32_t column, std::uint32_t y) const {
  if (y >= size_.height_px) return false;
  const auto runs = row(y);
  const auto next =
      std::partition_point(runs.begin(), runs.end(), [&](const PixelRun& run) { return run.behind <= column; });
  return next != runs.end() && next->first <= column;
}

LayerRuns LayerRuns::from_contours(std::span<const Contour> contours, PixelSize size, double pitch_mm) {
  LayerRuns out;
  out.size_ = size;
  std::vector<std::vector<std::pair<double, int>>> crossings(size.height_px);
  for (const Contour& contour : contours) {
    const auto v = contour.vertices();
    for (std::size_t i = 0; i < v.size(); ++i) {
      Point2 a = v[i], b = v[i + 1 < v.size() ? i + 1 : 0];
      const int sign = b.y_mm > a.y_mm ? 1 : -1;
      if (sign < 0) std::swap(a, b);
      const double first = std::max(0.0, std::ceil(a.y_mm / pitch_mm - 0.5));
      for (auto y = static_cast<std::uint32_t>(std::min(first, 1e9)); y < size.height_px; ++y) {
        const double centre = (y + 0.5) * pitch_mm;
        if (centre >= b.y_mm) break;
        if (centre < a.y_mm) continue;
        crossings[y].emplace_back(a.x_mm + (centre - a.y_mm) / (b.y_mm - a.y_mm) * (b.x_mm - a.x_mm), sign);
      }
    }
  }
  for (auto& row : crossings) {
    out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
    const std::size_t begin = out.runs_.size();
    std::sort(row.begin(), row.end());
    // Seen from the left an upward edge of an outer ring closes it: the sum of signs to the right is the winding.
    int winding = 0;
    for (std::size_t i = 0; i + 1 < row.size(); ++i) {
      winding -= row[i].second;
      if (winding <= 0) continue;
      const double from = std::ceil(row[i].first / pitch_mm - 0.5), to = std::ceil(row[i + 1].first / pitch_mm - 0.5);
      const auto first = static_cast<std::int32_t>(std::clamp(from, 0.0, size.width_px * 1.0));
      const auto behind = static_cast<std::int32_t>(std::clamp(to, 0.0, size.width_px * 1.0));
      if (first >= behind) continue;
      if (out.runs_.size() > begin && out.runs_.back().behind >= first)
        out.runs_.back().behind = std::max(out.runs_.back().behind, behind);
      else
        out.runs_.push_back({first, behind});
    }
  }
  out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
  return out;
}

LayerRuns LayerRuns::complement() const {
  LayerRuns out;
  out.size_ = size_;
  const auto width = static_cast<std::int32_t>(size_.width_px);
  for (std::uint32_t y = 0; y < size_.height_px; ++y) {
    out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
    std::int32_t next = 0;
    for (const PixelRun& run : row(y)) {
      if (run.first > next) out.runs_.push_back({next, run.first});
      next = run.behind;
    }
    if (next < width) out.runs_.push_back({next, width});
  }
  out.starts_.push_back(static_cast<std::uint32_t>(out.runs_.size()));
  return out;
}

std::span<const PixelRun> LayerRuns::row(std::uint32_t y) const {
  return {runs_.data() + starts_[y], runs_.data() + starts_[y + 1]};
}

RunComponents components_of(const LayerRuns& layer, bool diagonal) {
  RunComponents out;
  DisjointSets sets{layer.count()};
  const std::int32_t reach = diagonal ? 1 : 0;
  for (std::uint32_t y = 1; y < layer.size().height_px; ++y) {
    const auto below = layer.row(y - 1), here = layer.row(y);
    for (std::size_t i = 0, j = 0; i < below.size() && j < here.size();) {
      if (below[i].first < here[j].behind + reach && here[j].first < below[i].behind + reach)
        sets.join(layer.row_start(y - 1) + static_cast<std::uint32_t>(i),
                  layer.row_start(y) + static_cast<std::uint32_t>(j));
      if (below[i].behind < here[j].behind)
        ++i;
      else
        ++j;
    }
  }
  out.of_run = sets.numbers();
  const auto width = static_cast<std::int32_t>(layer.size().width_px);
  for (std::uint32_t y = 0; y < layer.size().height_px; ++y) {
    std::uint32_t index = layer.row_start(y);
    for (const PixelRun& run : layer.row(y)) {
      const std::uint32_t number = out.of_run[index++];
      if (number == out.components.size()) out.components.push_back({0, run.first, y, false});
      auto& component = out.components[number];
      component.pixels += static_cast<std::uint64_t>(run.width());
      component.touches_edge |= run.first == 0 || run.behind == width || y == 0 || y + 1 == layer.size().height_px;
    }
  }
  return out;
}

}  // namespace telefab::fab
