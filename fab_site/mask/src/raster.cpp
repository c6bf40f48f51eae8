#include <algorithm>
#include <cmath>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {
namespace {

/// What one edge adds to one pixel and to all pixels right of it: `cover` is the height crossed, `area` the part of it
/// that lies left of the pixel's right side within the pixel.
struct Cell {
  std::int32_t column;
  double cover;
  double area;
};

/// Collects the cells of all edges, row by row. Pixel units, y from the bottom.
class CellRows {
 public:
  explicit CellRows(PixelSize size) : width_{static_cast<std::int32_t>(size.width_px)}, rows_(size.height_px) {}

  void add_edge(double x0, double y0, double x1, double y1) {
    const double height = static_cast<double>(rows_.size());
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
    for (auto row = static_cast<std::int32_t>(std::floor(from)); y < to; ++row) {
      const bool last = to <= row + 1;
      const double next_y = last ? to : row + 1.0;
      const double next_x = last && to == y1 ? x1 : x0 + slope * (next_y - y0);
      if (next_y > y) add_within_row(static_cast<std::size_t>(row), x, y, next_x, next_y, sign);
      y = next_y;
      x = next_x;
    }
  }

  [[nodiscard]] std::vector<std::vector<Cell>>& rows() { return rows_; }

 private:
  /// A piece that stays in one row, split where it crosses from column to column.
  void add_within_row(std::size_t row, double x0, double y0, double x1, double y1, double sign) {
    const double dy = y1 - y0;
    double low = std::min(x0, x1);
    double high = std::max(x0, x1);
    const double width = width_;
    // What runs left of the mask covers its rows all the same; what runs right of it covers nothing.
    if (low >= width) return;
    if (high <= 0) return add_cell(row, 0, sign * dy, sign * dy);
    if (high - low < 1e-12) return add_column(row, low, high, sign * dy);
    const double per_x = dy / (high - low);
    if (low < 0) {
      add_cell(row, 0, sign * per_x * (0 - low), sign * per_x * (0 - low));
      low = 0;
    }
    high = std::min(high, width);
    double x = low;
    while (x < high) {
      const double next = std::min(high, std::floor(x) + 1);
      add_column(row, x, next, sign * per_x * (next - x));
      x = next;
    }
  }

  /// A piece within one column from `a` to `b` that crosses the signed height `cover`.
  void add_column(std::size_t row, double a, double b, double cover) {
    const double left = std::floor(a);
    if (left >= width_) return;
    const double mean = (a + b) / 2 - left;
    add_cell(row, static_cast<std::int32_t>(left), cover, cover * (1 - mean));
  }

  void add_cell(std::size_t row, std::int32_t column, double cover, double area) {
    rows_[row].push_back({column, cover, area});
  }

  std::int32_t width_;
  std::vector<std::vector<Cell>> rows_;
};

std::uint8_t grey(double share) { return static_cast<std::uint8_t>(std::clamp(share, 0.0, 1.0) * 255 + 0.5); }

/// Sums the cells of one row from left to right. Downward edges lie left of a counter-clockwise ring's inside, so the
/// sum is negative inside.
void fill_row(std::vector<Cell>& cells, std::uint8_t* row, std::size_t width) {
  std::stable_sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) { return a.column < b.column; });
  double cover = 0;
  for (std::size_t i = 0; i < cells.size();) {
    const auto column = static_cast<std::size_t>(cells[i].column);
    double area = cover;
    for (; i < cells.size() && static_cast<std::size_t>(cells[i].column) == column; ++i) {
      area += cells[i].area;
      cover += cells[i].cover;
    }
    row[column] = grey(-area);
    const std::size_t next = i < cells.size() ? static_cast<std::size_t>(cells[i].column) : width;
    const std::uint8_t level = grey(-cover);
    if (level != 0) std::fill(row + column + 1, row + next, level);
  }
}

}  // namespace

MaskFrame mask_frame(const MachineProfile& machine) { return {machine.mask_size(), machine.projection.pixel_pitch_mm}; }

Mask rasterise(std::span<const Contour> rings, const MaskFrame& frame) {
  CellRows cells{frame.size};
  for (const Contour& ring : rings) {
    const auto v = ring.vertices();
    for (std::size_t i = 0, j = v.size() - 1; i < v.size(); j = i++)
      cells.add_edge(v[j].x_mm / frame.pixel_pitch_mm, v[j].y_mm / frame.pixel_pitch_mm,
                     v[i].x_mm / frame.pixel_pitch_mm, v[i].y_mm / frame.pixel_pitch_mm);
  }
  Mask mask{frame.size, std::vector<std::uint8_t>(std::size_t{frame.size.width_px} * frame.size.height_px)};
  for (std::size_t y = 0; y < cells.rows().size(); ++y) {
    if (cells.rows()[y].empty()) continue;
    fill_row(cells.rows()[y], mask.rows.data() + (frame.size.height_px - 1 - y) * frame.size.width_px,
             frame.size.width_px);
  }
  return mask;
}

Mask merged(Mask mask, const Mask& other) {
  for (std::size_t i = 0; i < mask.rows.size(); ++i)
    mask.rows[i] = static_cast<std::uint8_t>(std::min(255, mask.rows[i] + other.rows[i]));
  return mask;
}

}  // namespace telefab::fab
