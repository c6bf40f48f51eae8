// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/fab/mask/mask.hpp>
#include <vector>

namespace telefab::fab {

/// A number for every pixel of a mask, y from the front, in squares that are stored only where they are not even.
class DoseTiles {
 public:
  static constexpr int kSide = 96;

  explicit DoseTiles(PixelSize size);
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }

  struct Tile {
    float even = 0;                   ///< of all pixels unless there are `pixels`
    std::unique_ptr<float[]> pixels;  ///< kSide * kSide
  };
  [[nodiscard]] Tile& tile(int column, int row) { return tiles_[index(column, row)]; }
  [[nodiscard]] const Tile& tile(int column, int row) const { return tiles_[index(column, row)]; }

  /// Copies the square of `side` pixels whose front left corner is (x, y); zero beyond the tiles.
  void copy_square(int x, int y, int side, float* to) const;
  /// The numbers of row y from column x on.
  void copy_row(int x, int y, int count, float* to) const;

 private:
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
  }
  int columns_;
  int rows_;
  std::vector<Tile> tiles_;
};

}  // namespace telefab::fab
