// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/image/frame.hpp>

namespace telefab::fab {

/// Pictures of some masks of a print, cut out to what the print occupies.
class ContactSheet {
 public:
  ContactSheet(const LayerStack& stack, const SupportPlan& supports, std::uint32_t print_layers,
               const MaskFrame& frame);
  [[nodiscard]] bool shows(std::uint32_t print_layer) const;
  /// What is lit, supports in their colour. Threads: from several at once.
  [[nodiscard]] Image tile_of(const Mask& mask, std::uint32_t print_layer) const;
  /// In order.
  void add(Image tile, std::uint32_t print_layer, double z_mm);
  /// `caption` says whose masks they are; legend, scale and axes are filled in.
  [[nodiscard]] Image draw(PictureCaption caption) const;

 private:
  /// The part of a mask that is shown.
  struct Crop {
    std::uint32_t x = 0;
    std::uint32_t y = 0;
    std::uint32_t width = 1;
    std::uint32_t height = 1;
  };
  [[nodiscard]] Image coloured(const Image& tile, std::uint32_t print_layer) const;
  [[nodiscard]] static Crop crop_of(const Bounds2& bounds, const MaskFrame& frame);
  Crop crop_;
  MaskFrame frame_;
  std::vector<Region> supports_;      ///< of the layers shown, as shown_
  std::vector<std::uint32_t> shown_;  ///< layers, rising
  std::vector<Image> tiles_;
  std::vector<std::string> labels_;
};

}  // namespace telefab::fab
