// SPDX-License-Identifier: GPL-3.0-or-later
#include "contact_sheet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/image/canvas.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kTiles = 24;
constexpr std::uint32_t kColumns = 6;
constexpr std::uint32_t kTilePx = 260;
constexpr std::uint32_t kSupportSamples = 16;  // a base is as wide at the bottom as supports ever are

/// Of everything that is printed, from the contours themselves: headers may state a whole platform.
Bounds2 printed_bounds(const LayerStack& stack, const SupportPlan& supports, std::uint32_t print_layers) {
  Bounds2 box = bounds_of(stack.layers());
  for (std::uint32_t i = 0; i < print_layers; i += std::max(1U, print_layers / kSupportSamples))
    for (const Contour& ring : supports.section(LayerIndex{i})) box.include(ring.bounds());
  return box;
}

}  // namespace

ContactSheet::Crop ContactSheet::crop_of(const Bounds2& bounds, const MaskFrame& frame) {
  const double margin_px = 2 + 3 / frame.pixel_pitch_mm;
  const auto clamp = [](double v, std::uint32_t most) {
    return static_cast<std::uint32_t>(std::clamp(v, 0.0, static_cast<double>(most)));
  };
  Crop crop;
  crop.x = clamp(std::floor(bounds.min.x_mm / frame.pixel_pitch_mm - margin_px), frame.size.width_px - 1);
  crop.y = clamp(std::floor(frame.size.height_px - bounds.max.y_mm / frame.pixel_pitch_mm - margin_px),
                 frame.size.height_px - 1);
  const std::uint32_t right = clamp(std::ceil(bounds.max.x_mm / frame.pixel_pitch_mm + margin_px), frame.size.width_px);
  const std::uint32_t lower =
      clamp(std::ceil(frame.size.height_px - bounds.min.y_mm / frame.pixel_pitch_mm + margin_px), frame.size.height_px);
  crop.width = std::max(1U, right > crop.x ? right - crop.x : 1U);
  crop.height = std::max(1U, lower > crop.y ? lower - crop.y : 1U);
  return crop;
}

ContactSheet::ContactSheet(const LayerStack& stack, const SupportPlan& supports, std::uint32_t print_layers,
                           const MaskFrame& frame)
    : crop_{crop_of(printed_bounds(stack, supports, print_layers), frame)} {
  const std::uint32_t tiles = std::min(kTiles, print_layers);
  for (std::uint32_t t = 0; t < tiles; ++t)
    shown_.push_back(tiles == 1 ? 0 : static_cast<std::uint32_t>(std::uint64_t{t} * (print_layers - 1) / (tiles - 1)));
}

bool ContactSheet::shows(std::uint32_t print_layer) const {
  return std::binary_search(shown_.begin(), shown_.end(), print_layer);
}

Image ContactSheet::tile_of(const Mask& mask) const {
  Image image{crop_.width, crop_.height, 1, {}};
  image.pixels.reserve(std::size_t{crop_.width} * crop_.height);
  for (std::uint32_t y = 0; y < crop_.height; ++y) {
    const auto row =
        mask.rows.begin() + static_cast<std::ptrdiff_t>(std::size_t{crop_.y + y} * mask.size.width_px + crop_.x);
    image.pixels.insert(image.pixels.end(), row, row + crop_.width);
  }
  return shrunk_to(std::move(image), kTilePx);
}

void ContactSheet::add(Image tile, std::uint32_t print_layer, double z_mm) {
  tiles_.push_back(std::move(tile));
  labels_.push_back(fmt::format("layer {}  z {:.2f} mm", print_layer, z_mm));
}

Image ContactSheet::draw() const { return contact_sheet(tiles_, labels_, kColumns, kTilePx); }

}  // namespace telefab::fab
