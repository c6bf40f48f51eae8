// SPDX-License-Identifier: GPL-3.0-or-later
#include "cover_cells.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace telefab::fab {
namespace {

constexpr double kMostMitre = 2;  // a sharp vertex moves by at most this times the way of its edges

std::uint8_t grey(double share) { return static_cast<std::uint8_t>(std::clamp(share, 0.0, 1.0) * 255 + 0.5); }

/// The ring in pixels, its edges moved to their left (the inside) by `way_px`.
std::vector<Point2> moved_ring(std::span<const Point2> ring, double pitch_mm, double way_px) {
  std::vector<Point2> moved(ring.size());
  for (std::size_t i = 0; i < ring.size(); ++i) moved[i] = {ring[i].x_mm / pitch_mm, ring[i].y_mm / pitch_mm};
  if (way_px == 0) return moved;
  const std::vector<Point2> from = moved;
  const auto normal = [&](std::size_t a, std::size_t b) {
    const double dx = from[b].x_mm - from[a].x_mm, dy = from[b].y_mm - from[a].y_mm, length = std::hypot(dx, dy);
    return length > 0 ? Point2{-dy / length, dx / length} : Point2{};
  };
  for (std::size_t i = 0, n = from.size(); i < n; ++i) {
    const Point2 before = normal((i + n - 1) % n, i), after = normal(i, (i + 1) % n);
    const double x = before.x_mm + after.x_mm, y = before.y_mm + after.y_mm;
    const double scale = std::min(2 / std::max(x * x + y * y, 1e-9), kMostMitre) * way_px;
    moved[i] = {from[i].x_mm + x * scale, from[i].y_mm + y * scale};
  }
  return moved;
}

}  // namespace

CoverCells::CoverCells(std::span<const Contour> rings, const MaskFrame& frame, double inwards_px) : size_{frame.size} {
  for (const Contour& ring : rings) {
    const auto v = moved_ring(ring.vertices(), frame.pixel_pitch_mm, inwards_px);
    for (std::size_t i = 0, j = v.size() - 1; i < v.size(); j = i++)
      add_edge(v[j].x_mm, v[j].y_mm, v[i].x_mm, v[i].y_mm);
  }
  sort_cells();
}

void CoverCells::add_edge(double x0, double y0, double x1, double y1) {
  const double height = size_.height_px;
  if (y0 == y1) return;
  const double sign = y1 < y0 ? -1 : 1;
  if (sign < 0) {
    std::swap(x0, x1);
    std::swap(y0, y1);
  }
  if (y1 <= 0 || y0 >= height) return;
  const double slope = (x1 - x0) / (y1 - y0);
  const double from = std::max(y0, 0.0);
  const double to = std::min(y1, height);
  double y = from;
  double x = y0 < 0 ? x0 + slope * (0 - y0) : x0;
  for (auto row = static_cast<std::int32_t>(from); y < to; ++row) {
    const bool last = to <= row + 1;
    const double next_y = last ? to : row + 1.0;
    const double next_x = last && to == y1 ? x1 : x0 + slope * (next_y - y0);
    if (next_y > y) add_within_row(row, x, y, next_x, next_y, sign);
    y = next_y;
    x = next_x;
  }
}

/// A piece that stays in one row, split where it crosses from column to column.
void CoverCells::add_within_row(std::int32_t row, double x0, double y0, double x1, double y1, double sign) {
  const double dy = y1 - y0;
  double low = std::min(x0, x1);
  double high = std::max(x0, x1);
  const double width = size_.width_px;
  const auto add_column = [&](double a, double b, double cover) {
    const auto left = static_cast<std::int32_t>(a);
    if (left < static_cast<std::int32_t>(size_.width_px))
      add_cell(row, left, cover, cover * (1 - ((a + b) / 2 - left)));
  };
  // What runs left of the mask covers its rows all the same; what runs right of it covers nothing.
  if (low >= width) return;
  if (high <= 0) return add_cell(row, 0, sign * dy, sign * dy);
  if (high - low < 1e-12) return add_column(std::max(low, 0.0), std::max(high, 0.0), sign * dy);
  const double per_x = dy / (high - low);
  if (low < 0) {
    add_cell(row, 0, sign * per_x * (0 - low), sign * per_x * (0 - low));
    low = 0;
  }
  high = std::min(high, width);
  double x = low;
  while (x < high) {
    const double next = std::min(high, static_cast<std::int32_t>(x) + 1.0);
    add_column(x, next, sign * per_x * (next - x));
    x = next;
  }
}

void CoverCells::add_cell(std::int32_t row, std::int32_t column, double cover, double area) {
  if (!cells_.empty() && cells_.back().row == row && cells_.back().column == column) {
    cells_.back().cover += cover;
    cells_.back().area += area;
  } else {
    cells_.push_back({row, column, cover, area});
  }
}

void CoverCells::sort_cells() {
  starts_.assign(std::size_t{size_.height_px} + 1, 0);
  for (const Cell& cell : cells_) ++starts_[static_cast<std::size_t>(cell.row) + 1];
  for (std::size_t y = 1; y < starts_.size(); ++y) starts_[y] += starts_[y - 1];
  std::vector<Cell> sorted(cells_.size());
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
  for (const Cell& cell : cells_) {
    // Few cells lie in a row, and neighbours mostly come in order: insertion keeps the order of equal columns.
    const std::size_t row = static_cast<std::size_t>(cell.row), first = starts_[row];
    std::size_t at = next[row]++;
    for (; at > first && sorted[at - 1].column > cell.column; --at) sorted[at] = sorted[at - 1];
    sorted[at] = cell;
  }
  cells_ = std::move(sorted);
}

/// Sums the cells of one row from left to right. Downward edges lie left of a counter-clockwise ring's inside, so the
/// sum is negative inside.
void CoverCells::fill(std::uint32_t y, std::uint8_t* row) const {
  const Cell* cell = cells_.data() + starts_[y];
  const Cell* const end = cells_.data() + starts_[y + 1];
  const std::size_t width = size_.width_px;
  std::size_t done = 0;
  double cover = 0;
  while (cell != end) {
    const auto column = static_cast<std::size_t>(cell->column);
    if (column > done) std::memset(row + done, grey(-cover), column - done);
    double area = cover;
    for (; cell != end && static_cast<std::size_t>(cell->column) == column; ++cell) {
      area += cell->area;
      cover += cell->cover;
    }
    row[column] = grey(-area);
    done = column + 1;
  }
  if (done < width) std::memset(row + done, grey(-cover), width - done);
}

}  // namespace telefab::fab
