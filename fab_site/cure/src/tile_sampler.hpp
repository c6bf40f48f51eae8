// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/dose_field.hpp>

namespace telefab::fab {

/// Tiles at multiples of kTileSide, from at or below a box to beyond it.
struct TileRange {
  int x = 0;  ///< pixels, of the first
  int y = 0;
  int columns = 0;
  int rows = 0;
};
inline constexpr int kTileSide = 8;
[[nodiscard]] TileRange tiles_of(const PixelBox& box);

using TileBounds = DoseField::TileBounds;
/// Of all tiles of a field, row by row; by its pixels and box alone.
[[nodiscard]] std::vector<TileBounds> all_bounds(const DoseField& dose);
/// Those of one row of a range, which may reach beyond the field's own tiles.
[[nodiscard]] std::vector<TileBounds> bounds_of_row(const DoseField& dose, const TileRange& range, int row);

/// The dose field on regular points of a tile, by the separable kernel. Threads: as const.
class TileSampler {
 public:
  /// Points at (i + shift) / per_pixel of every pixel, i = 0 .. per_pixel - 1, on both axes.
  TileSampler(const PixelKernel& kernel, int per_pixel, double shift);

  [[nodiscard]] std::size_t points() const { return static_cast<std::size_t>(kTileSide) * per_pixel_; }
  /// Row by row from the front, points() each.
  void sample(const DoseField& dose, int x, int y, std::span<float> out) const;

 private:
  int per_pixel_;
  int reach_;
  int padded_;
  std::vector<float> phases_;  ///< weights of every point of a pixel, padded
};

/// The dose along straight lines through a tile: at kTileSide * per_pixel + 1 points from side to side.
class LineSampler {
 public:
  /// Lines at (i + 1/2) / lines of every pixel.
  LineSampler(const PixelKernel& kernel, int per_pixel, int lines);

  [[nodiscard]] std::size_t points() const { return static_cast<std::size_t>(kTileSide) * along_ + 1; }
  [[nodiscard]] std::size_t lines() const { return static_cast<std::size_t>(kTileSide) * across_; }
  /// Lines along x from the front on, or along y from the left on; points() each.
  void sample(const DoseField& dose, int x, int y, bool along_y, std::span<float> out) const;

 private:
  int along_;
  int across_;
  int reach_;
  int padded_;
  std::vector<float> along_phases_;
  std::vector<float> across_phases_;
};

}  // namespace telefab::fab
