// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stop_token>
#include <telefab/base/digest.hpp>
#include <telefab/fab/cure/dose_field.hpp>

namespace telefab::fab {

/// How deep one layer is cured from its newest side, sub-pixel by sub-pixel, in tiles of kTilePx x kTilePx pixels that
/// lie at multiples of kTilePx whatever was lit; tiles without cured resin are left out. Sample (i, j) of a pixel
/// stands for the square (i .. i + 1) / S of it and holds the depth at its middle.
class DepthMap {
 public:
  static constexpr int kTilePx = 8;
  static constexpr std::uint16_t kWhole = 65535;  ///< the layer's thickness; depths are shares of it

  struct Tile {
    int x = 0;  ///< of its left side, pixels
    int y = 0;  ///< of its front side, pixels
    bool whole = false;
    std::size_t first = 0;  ///< of its depths unless whole
  };

  /// `sub_pixels` 1 to 16 samples a pixel and axis.
  [[nodiscard]] static DepthMap of(const DoseField& dose, const CureModel& model, int sub_pixels);

  [[nodiscard]] int sub_pixels() const { return sub_pixels_; }
  /// By y, then x.
  [[nodiscard]] std::span<const Tile> tiles() const { return tiles_; }
  /// Depths of a tile, rows from the front, kTilePx * S each; empty where the tile is whole.
  [[nodiscard]] std::span<const std::uint16_t> depths(const Tile& tile) const;
  /// In pixels times layers.
  [[nodiscard]] double volume() const { return volume_; }
  /// Of what is cured: maps with the same depths have the same digest.
  [[nodiscard]] Digest digest() const;

 private:
  int sub_pixels_ = 1;
  double volume_ = 0;
  std::vector<Tile> tiles_;
  std::vector<std::uint16_t> depths_;
};

}  // namespace telefab::fab
