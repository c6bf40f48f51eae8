// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/mask/mask_light.hpp>
#include <telefab/fab/mask/pixel_runs.hpp>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {

/// How much light a layer of a column may give so that all light of the column together cures down to its underside
/// and no deeper: later layers shine through it, so the lowest ones stay dark and the next one is grey. By the number
/// of solid layers below it in its column and above it.
class CapTable {
 public:
  /// `most_above`: layers above that are told apart; those beyond shine through too little to count.
  CapTable(const MaskLight& light, int most_above);
  /// From this many solid layers below on, a layer is never capped.
  [[nodiscard]] int reach() const { return reach_; }
  [[nodiscard]] int most_above() const { return most_above_; }
  /// As grey share of white, 255: all.
  [[nodiscard]] std::uint8_t cap(int below, int above) const;

 private:
  int most_above_;
  int reach_ = 0;
  std::vector<std::uint8_t> caps_;
};

/// The pixels of a layer that are solid, in runs; a pixel counts from an eighth of cover on, so that the edge of an
/// upright wall that wavers does not look like an underside.
class SolidRows {
 public:
  SolidRows(std::span<const Contour> part, std::span<const Contour> supports, const MaskFrame& frame);
  /// Part and supports.
  [[nodiscard]] const PixelRuns& solid() const { return solid_; }
  /// The pixels of supports alone.
  [[nodiscard]] const PixelRuns& supports() const { return supports_; }
  [[nodiscard]] bool any_support() const { return !supports_.empty(); }
  /// Row y from the front.
  [[nodiscard]] std::span<const PixelRun> row(std::uint32_t y) const { return solid_.row(y); }
  [[nodiscard]] std::span<const PixelRun> support_row(std::uint32_t y) const { return supports_.row(y); }
  [[nodiscard]] std::uint32_t rows() const { return solid_.rows(); }

 private:
  PixelRuns solid_, supports_;
};

/// The caps of one layer. `below` and `above` nearest first, as far as the table looks; what lies below the last of
/// `below` counts as solid if `on_platform`. All given must outlive the constructor only.
///
/// A column over a support is not capped: light that goes too deep there cures the support. And a rim of one or two
/// pixels is lit no more than the darkest pixel on its best way to one that is not capped: around a dark underside it
/// would cure first, badly, and float. Wider ones stay lit, or thin sheets would lose what the body hangs on.
class LayerCaps {
 public:
  LayerCaps(const CapTable& table, const SolidRows& here, const std::vector<const SolidRows*>& below,
            const std::vector<const SolidRows*>& above, bool on_platform);
  /// Whether any pixel of row y is capped; if so `row` (width_px) gets caps, else it is left alone.
  bool fill(std::uint32_t y, std::span<std::uint8_t> row) const;

 private:
  void darken_what_floats();

  std::uint32_t front_ = 0;         ///< first row of the box around what is solid
  std::size_t from_ = 0;            ///< its first column
  std::size_t width_ = 0;           ///< of the box
  std::vector<char> capped_;        ///< by row of the box
  std::vector<std::uint8_t> caps_;  ///< of the box; 255 where there are none, 0 where nothing is solid
  std::vector<std::uint8_t> held_;  ///< of the box while it is made: 255 for pixels without cap
};

}  // namespace telefab::fab
