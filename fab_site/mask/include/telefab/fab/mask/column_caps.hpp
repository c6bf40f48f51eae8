#pragma once
#include <telefab/fab/mask/mask_light.hpp>
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
  struct Run {
    std::int32_t first = 0;
    std::int32_t behind = 0;
  };
  /// Row y from the front.
  [[nodiscard]] std::span<const Run> row(std::uint32_t y) const;

 private:
  std::vector<Run> runs_;
  std::vector<std::uint32_t> starts_;
};

/// The caps of one layer. `below` and `above` nearest first, as far as the table looks; what lies below the last of
/// `below` counts as solid if `on_platform`. All given must outlive it.
class LayerCaps {
 public:
  LayerCaps(const CapTable& table, const SolidRows& here, std::vector<const SolidRows*> below,
            std::vector<const SolidRows*> above, bool on_platform);
  /// Whether any pixel of row y is capped; if so `row` (width_px) gets caps, else it is left alone.
  bool fill(std::uint32_t y, std::span<std::uint8_t> row) const;

 private:
  const CapTable* table_;
  const SolidRows* here_;
  std::vector<const SolidRows*> below_, above_;
  bool on_platform_;
};

}  // namespace telefab::fab
