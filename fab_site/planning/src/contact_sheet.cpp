// SPDX-License-Identifier: GPL-3.0-or-later
#include "contact_sheet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/image/palette.hpp>

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
    : crop_{crop_of(printed_bounds(stack, supports, print_layers), frame)}, frame_{frame} {
  const std::uint32_t tiles = std::min(kTiles, print_layers);
  for (std::uint32_t t = 0; t < tiles; ++t)
    shown_.push_back(tiles == 1 ? 0 : static_cast<std::uint32_t>(std::uint64_t{t} * (print_layers - 1) / (tiles - 1)));
  for (const std::uint32_t layer : shown_) supports_.push_back(supports.section_region(LayerIndex{layer}));
}

bool ContactSheet::shows(std::uint32_t print_layer) const {
  return std::binary_search(shown_.begin(), shown_.end(), print_layer);
}

Image ContactSheet::tile_of(const Mask& mask, std::uint32_t print_layer) const {
  Image image{crop_.width, crop_.height, 1, {}};
  image.pixels.reserve(std::size_t{crop_.width} * crop_.height);
  for (std::uint32_t y = 0; y < crop_.height; ++y) {
    const auto row =
        mask.rows.begin() + static_cast<std::ptrdiff_t>(std::size_t{crop_.y + y} * mask.size.width_px + crop_.x);
    image.pixels.insert(image.pixels.end(), row, row + crop_.width);
  }
  return coloured(shrunk_to(std::move(image), kTilePx), print_layer);
}

Image ContactSheet::coloured(const Image& tile, std::uint32_t print_layer) const {
  // How much of a pixel is support's, as a picture of the supports alone.
  Canvas canvas{tile.width_px, tile.height_px, {}};
  const double across = static_cast<double>(tile.width_px) / crop_.width,
               down = static_cast<double>(tile.height_px) / crop_.height;
  std::vector<std::vector<PixelPoint>> rings;
  const auto at = std::ranges::lower_bound(shown_, print_layer) - shown_.begin();
  for (const GridRing& ring : supports_[static_cast<std::size_t>(at)].rings()) {
    auto& points = rings.emplace_back();
    for (const GridPoint& vertex : ring) {
      const Point2 p = to_mm(vertex);
      points.push_back({(p.x_mm / frame_.pixel_pitch_mm - crop_.x) * across,
                        (frame_.size.height_px - p.y_mm / frame_.pixel_pitch_mm - crop_.y) * down});
    }
  }
  if (!rings.empty()) canvas.fill(rings, {255, 255, 255});
  const Image share = canvas.image();
  Image picture{tile.width_px, tile.height_px, 3, {}};
  picture.pixels.reserve(3 * tile.pixels.size());
  for (std::size_t i = 0; i < tile.pixels.size(); ++i) {
    const Colour ink = palette::mixed(palette::kPaper, palette::kSupport, share.pixels[3 * i] / 255.0);
    for (const std::uint8_t value : {ink.red, ink.green, ink.blue})
      picture.pixels.push_back(static_cast<std::uint8_t>(value * tile.pixels[i] / 255));
  }
  return picture;
}

void ContactSheet::add(Image tile, std::uint32_t print_layer, double z_mm) {
  tiles_.push_back(std::move(tile));
  labels_.push_back(fmt::format("layer {}, z = {:.2f} mm", print_layer, z_mm));
}

Image ContactSheet::draw(PictureCaption caption) const {
  caption.legend = {{palette::kPaper, "lit: part"}, {palette::kSupport, "lit: supports and base"}, {{}, "dark"}};
  caption.px_per_mm = tiles_.empty() ? 0 : tiles_.front().width_px / (crop_.width * frame_.pixel_pitch_mm);
  caption.axes = axes_of_plane();
  return framed(contact_sheet(tiles_, labels_, kColumns, kTilePx), caption);
}

}  // namespace telefab::fab
