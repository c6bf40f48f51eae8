// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {

/// What the edges of all rings add to the pixels they cross, sorted, so that any row of the cover can be had at any
/// time: a mask need not be held to know a part of it. Memory is proportional to contour length in pixels.
class CoverCells {
 public:
  /// Vertices are moved inwards by `inwards_px` along their normals first; loops that this makes count as nothing.
  CoverCells(std::span<const Contour> rings, const MaskFrame& frame, double inwards_px = 0);

  /// Writes the cover of row `y` (0 is the front) as grey, all width_px of them.
  void fill(std::uint32_t y, std::uint8_t* row) const;
  [[nodiscard]] bool empty() const { return cells_.empty(); }
  [[nodiscard]] bool empty(std::uint32_t y) const { return starts_[y] == starts_[y + 1]; }

 private:
  /// What one edge adds to one pixel and to all pixels right of it: `cover` is the height crossed, `area` the part of
  /// it that lies left of the pixel's right side within the pixel.
  struct Cell {
    std::int32_t row;
    std::int32_t column;
    double cover;
    double area;
  };

  void add_edge(double x0, double y0, double x1, double y1);
  void add_within_row(std::int32_t row, double x0, double y0, double x1, double y1, double sign);
  void add_cell(std::int32_t row, std::int32_t column, double cover, double area);
  void sort_cells();

  PixelSize size_;
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> starts_;  ///< by row, and one more
};

}  // namespace telefab::fab
