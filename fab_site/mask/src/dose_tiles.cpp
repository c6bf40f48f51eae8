// SPDX-License-Identifier: GPL-3.0-or-later
#include "dose_tiles.hpp"

#include <algorithm>

namespace telefab::fab {

DoseTiles::DoseTiles(PixelSize size)
    : columns_{(static_cast<int>(size.width_px) + kSide - 1) / kSide},
      rows_{(static_cast<int>(size.height_px) + kSide - 1) / kSide},
      tiles_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_)) {}

void DoseTiles::copy_row(int x, int y, int count, float* to) const {
  if (y < 0 || y >= rows_ * kSide) {
    std::fill(to, to + count, 0.0F);
    return;
  }
  for (int done = 0; done < count;) {
    const int at = x + done;
    if (at < 0 || at >= columns_ * kSide) {
      const int some = at < 0 ? std::min(-at, count - done) : count - done;
      std::fill(to + done, to + done + some, 0.0F);
      done += some;
      continue;
    }
    const int some = std::min(kSide - at % kSide, count - done);
    const Tile& from = tile(at / kSide, y / kSide);
    if (from.pixels)
      std::copy_n(from.pixels.get() + (y % kSide) * kSide + at % kSide, some, to + done);
    else
      std::fill_n(to + done, some, from.even);
    done += some;
  }
}

DoseTiles::Box DoseTiles::box_of(float least) const {
  Box box{columns_ * kSide, 0, rows_ * kSide, 0};
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      const Tile& each = tile(column, row);
      if (!each.pixels && each.even < least) continue;
      box.left = std::min(box.left, column * kSide);
      box.right = std::max(box.right, (column + 1) * kSide);
      box.front = std::min(box.front, row * kSide);
      box.back = (row + 1) * kSide;
    }
  return box.is_empty() ? Box{} : box;
}

}  // namespace telefab::fab
