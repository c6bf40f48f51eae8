// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/mask/mask.hpp>
#include <telefab/image/png.hpp>
#include <vector>

namespace telefab::fab {

/// What archives tell of one layer. Pixels of the picture, rows from the top; `right` and `bottom` are one beyond.
struct LayerSurvey {
  std::uint32_t left = 0;
  std::uint32_t top = 0;
  std::uint32_t right = 0;
  std::uint32_t bottom = 0;
  double solid_px = 0;    ///< grey-weighted
  double largest_px = 0;  ///< of the pieces that hang together over pixel sides, lit pixels counted
  double smallest_px = 0;
  std::uint32_t pieces = 0;
};

[[nodiscard]] LayerSurvey survey(const MaskView& mask);

/// The print seen from above, layer by layer: every place remembers the highest layer that was lit there.
class ViewFromAbove {
 public:
  /// The whole mask fits into a picture of this size.
  ViewFromAbove(PixelSize mask, std::uint32_t width_px, std::uint32_t height_px);
  void add(const MaskView& mask, std::uint32_t layer);
  /// RGB, higher is lighter, slopes are lit from the upper left.
  [[nodiscard]] Image image(std::uint32_t layers) const;

 private:
  PixelSize mask_;
  std::uint32_t width_px_;
  std::uint32_t height_px_;
  std::vector<std::uint32_t> columns_;  ///< of the mask, for every column of the picture; kNowhere beside it
  std::vector<std::uint32_t> rows_;
  std::vector<std::uint32_t> heights_;  ///< layer + 1, 0 where nothing was lit
};

}  // namespace telefab::fab
