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

  /// Pixels outside of which no number reaches `least`, in whole tiles; empty: none does.
  struct Box {
    int left = 0, right = 0;  ///< right and back count no more
    int front = 0, back = 0;
    [[nodiscard]] bool is_empty() const { return left >= right; }
  };
  [[nodiscard]] Box box_of(float least) const;
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
