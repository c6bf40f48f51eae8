// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <optional>
#include <telefab/fab/cure/cure_model.hpp>
#include <telefab/fab/cure/pixel_kernel.hpp>
#include <vector>

namespace telefab::fab {

/// A place on the mask in pixels: x from its left side, y from its front (lower) side, as build frame / pitch.
struct PixelPlace {
  double x_px = 0;
  double y_px = 0;
};

/// Whole pixels; y counts from the front. May reach beyond the mask, where nothing shines.
struct PixelBox {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
  [[nodiscard]] bool empty() const { return width <= 0 || height <= 0; }
};

/// B of one layer over the plane: exact at any point, because the blur of a sum is the sum of the blurs. Keeps the
/// accumulated dose of every pixel and applies the kernel where asked. Zero outside of what was ever lit.
/// Threads: const methods from several threads at once.
class DoseField {
 public:
  struct Sample {
    double dose = 0;     ///< B
    double slope_x = 0;  ///< per pixel
    double slope_y = 0;
  };

  /// Nothing was lit.
  explicit DoseField(std::shared_ptr<const PixelKernel> kernel) : kernel_{std::move(kernel)} {}
  /// What no point of a tile of 8 x 8 pixels is below or above.
  struct TileBounds {
    float least = 0;
    float most = 0;
  };
  /// `pixels` row by row from the front; box and pixels must agree. Cost: one pass for the bounds of tiles, on oneTBB.
  DoseField(std::shared_ptr<const PixelKernel> kernel, PixelBox box, std::vector<float> pixels);

  /// Every point beyond it has the dose of its border.
  [[nodiscard]] const PixelBox& box() const { return box_; }
  [[nodiscard]] const PixelKernel& kernel() const { return *kernel_; }
  /// Accumulated dose of one pixel before the blur; the border's beyond the box, zero for an empty box.
  [[nodiscard]] float pixel(int x, int y) const;
  /// Those of one row, box().width of them from box().x on; the border's row beyond the box. The box is not empty.
  [[nodiscard]] const float* row(int y) const;
  /// Of the tiles in the rows and columns that tiles_of(box()) counts; for code that walks whole layers.
  [[nodiscard]] std::span<const TileBounds> tile_bounds() const { return bounds_; }
  [[nodiscard]] Sample sample(PixelPlace place) const;

 private:
  std::shared_ptr<const PixelKernel> kernel_;
  PixelBox box_;
  std::vector<float> pixels_;
  std::vector<TileBounds> bounds_;
};

/// Walks down through a print: light of the newest layer first. Holds one layer's pixels, cropped to what was lit so
/// far. Same bytes on any number of threads (oneTBB, over rows).
class DoseStream {
 public:
  explicit DoseStream(const CureModel& model);
  [[nodiscard]] const CureModel& model() const { return model_; }
  /// Goes one layer down and adds what was shown there: nothing, one mask, or several. Exposures of the same mask are
  /// summed in nanoseconds first, so that an interrupted exposure counts as the whole one.
  /// Fails with InvalidInput: a mask of another size, a negative time.
  [[nodiscard]] Result<DoseField> descend(std::span<const MaskExposure> exposures);

 private:
  CureModel model_;
  std::shared_ptr<const PixelKernel> kernel_;
  PixelBox box_;
  std::vector<float> pixels_;
};

}  // namespace telefab::fab
