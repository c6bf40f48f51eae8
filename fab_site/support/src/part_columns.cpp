// SPDX-License-Identifier: GPL-3.0-or-later
#include "part_columns.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "scan_lines.hpp"

namespace telefab::fab {
namespace {

using Bitmap = std::vector<std::uint8_t>;

/// Every cell that the region touches, or whose centre line it crosses; sampled on three scan lines a cell.
void draw(const Region& region, Point2 origin, double cell, int columns, int rows, Bitmap& bits) {
  constexpr int kLines = 3;
  const auto cell_at = [&](double along, double from, int count) {
    return std::clamp(static_cast<int>((along - from) / cell), 0, count - 1);
  };
  for (const GridRing& ring : region.rings())
    for (const GridPoint& corner : ring) {
      const Point2 p = to_mm(corner);
      bits[static_cast<std::size_t>(cell_at(p.y_mm, origin.y_mm, rows) * columns +
                                    cell_at(p.x_mm, origin.x_mm, columns))] = 1;
    }
  ScanLines lines{origin.y_mm, cell / kLines, rows * kLines};
  for (const GridRing& ring : region.rings()) lines.add(ring);
  lines.for_spans([&](int line, double from, double to) {
    const int c0 = cell_at(from, origin.x_mm, columns), c1 = cell_at(to, origin.x_mm, columns);
    std::fill_n(bits.begin() + (line / kLines) * columns + c0, c1 - c0 + 1, std::uint8_t{1});
  });
}

Bitmap grown(const Bitmap& bits, int columns, int rows, double radius_cells) {
  const int reach = static_cast<int>(std::ceil(radius_cells));
  if (reach == 0) return bits;
  Bitmap out(bits.size(), 0);
  for (int dy = -reach; dy <= reach; ++dy) {
    const double across = radius_cells * radius_cells - std::max(0, std::abs(dy) - 1) * std::max(0, std::abs(dy) - 1);
    const int half = static_cast<int>(std::ceil(std::sqrt(std::max(0.0, across))));
    for (int row = std::max(0, -dy); row < std::min(rows, rows - dy); ++row) {
      const std::uint8_t* from = bits.data() + row * columns;
      std::uint8_t* to = out.data() + (row + dy) * columns;
      int until = -1;
      for (int c = 0; c < columns; ++c) {  // spans to the right of set cells, then the mirror of it
        if (from[c]) until = c + half;
        if (c <= until) to[c] = 1;
      }
      until = columns;
      for (int c = columns - 1; c >= 0; --c) {
        if (from[c]) until = c - half;
        if (c >= until) to[c] = 1;
      }
    }
  }
  return out;
}

}  // namespace

PartColumns::PartColumns(std::span<const Region> layers, double grow_mm, double cell_mm) : cell_mm_{cell_mm} {
  Bounds2 box = Bounds2::nothing();
  for (const Region& region : layers)
    if (!region.empty()) box.include(region.bounds());
  if (box.is_nothing()) return;
  const double margin = grow_mm + 2 * cell_mm;
  origin_ = {box.min.x_mm - margin, box.min.y_mm - margin};
  columns_ = static_cast<int>((box.max.x_mm + margin - origin_.x_mm) / cell_mm) + 1;
  rows_ = static_cast<int>((box.max.y_mm + margin - origin_.y_mm) / cell_mm) + 1;
  runs_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  // Blocks of layers are drawn in parallel, then appended to the columns in order.
  constexpr std::size_t kBlock = 64;
  std::vector<Bitmap> block(kBlock);
  for (std::size_t start = 0; start < layers.size(); start += kBlock) {
    const std::size_t count = std::min(kBlock, layers.size() - start);
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      Bitmap bits(runs_.size(), 0);
      draw(layers[start + i], origin_, cell_mm_, columns_, rows_, bits);
      block[i] = grow_mm > 0 ? grown(bits, columns_, rows_, grow_mm / cell_mm_) : std::move(bits);
    });
    tbb::parallel_for(0, rows_, [&](int row) {
      for (std::size_t i = 0; i < count; ++i) {
        const auto layer = static_cast<std::uint32_t>(start + i);
        for (std::size_t c = static_cast<std::size_t>(row * columns_), end = c + static_cast<std::size_t>(columns_);
             c < end; ++c) {
          if (!block[i][c]) continue;
          auto& runs = runs_[c];
          if (!runs.empty() && runs.back().last + 1 == layer)
            runs.back().last = layer;
          else
            runs.push_back({layer, layer});
        }
      }
    });
  }
}

const std::vector<PartColumns::Run>* PartColumns::column(Point2 place) const {
  const double c = std::floor((place.x_mm - origin_.x_mm) / cell_mm_);
  const double r = std::floor((place.y_mm - origin_.y_mm) / cell_mm_);
  if (!(c >= 0 && r >= 0 && c < columns_ && r < rows_)) return nullptr;
  return &runs_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(c)];
}

std::optional<std::uint32_t> PartColumns::highest_below(Point2 place, std::int64_t layer) const {
  const auto* runs = column(place);
  if (runs == nullptr || layer <= 0) return std::nullopt;
  const auto above = std::partition_point(runs->begin(), runs->end(), [&](const Run& r) { return r.first < layer; });
  if (above == runs->begin()) return std::nullopt;
  const Run& run = *(above - 1);
  return static_cast<std::uint32_t>(std::min<std::int64_t>(run.last, layer - 1));
}

bool PartColumns::occupied(Point2 place, std::int64_t layer) const {
  const auto found = highest_below(place, layer + 1);
  return found && *found == layer;
}

}  // namespace telefab::fab
