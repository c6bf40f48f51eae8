// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <telefab/base/result.hpp>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// A set of pixels, rows from the front to the back.
class PixelSet {
 public:
  /// None of width x height pixels; (0, 0) is pixel (left, front) of the mask, counted from its front left corner.
  PixelSet(int left, int front, int width, int height)
      : left_{left},
        front_{front},
        width_{width},
        height_{height},
        lit_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}
  /// False outside.
  [[nodiscard]] bool has(int x, int y) const {
    return x >= 0 && y >= 0 && x < width_ && y < height_ && lit_[place(x, y)] != 0;
  }
  void add(int x, int y) { lit_[place(x, y)] = 1; }
  [[nodiscard]] std::uint64_t count() const;
  /// Its outlines along the edges of pixels, holes clockwise, in mm of the mask. Where two pixels meet in a corner
  /// alone, one beside them is taken along, so that no ring meets itself or another.
  [[nodiscard]] Result<std::vector<Contour>> rings(double pitch_mm) const;

 private:
  [[nodiscard]] std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }
  /// With what joins pixels that meet in a corner alone.
  [[nodiscard]] PixelSet joined() const;
  int left_, front_, width_, height_;
  std::vector<std::uint8_t> lit_;
};

}  // namespace telefab::fab
