// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <telefab/fab/verify/support_check.hpp>
#include <vector>

namespace telefab::fab {

/// A connected piece of one layer.
struct Piece {
  std::uint32_t layer = 0;
  std::int64_t pixels = 0;
  std::int64_t pulled = 0;  ///< of them, when the layer has just been exposed
  Point2 middle;            ///< mm
};

/// Where two pieces of consecutive layers meet.
struct Section {
  std::uint32_t upper = 0, lower = 0;  ///< pieces
  std::int64_t pixels = 0;
  double area_mm2 = 0;
  Point2 middle;                     ///< mm
  double xx = 0, xy = 0, yy = 0;     ///< mm2: second moments of area about the middle, over the area
  std::array<double, 8> reach_mm{};  ///< beyond the middle, in directions of i * 45 degrees

  /// How far it reaches beyond its middle along a vector, times the vector's length; errs upwards by at most a
  /// twelfth of a disc's radius.
  [[nodiscard]] double along(Point2 vector) const;
};

/// Pieces and sections of a print, from the platform up.
class LoadPath {
 public:
  LoadPath(double pitch_mm, double thickness_mm) : pitch_mm_{pitch_mm}, thickness_mm_{thickness_mm} {}
  /// Bodies are of all solid pixels; areas and middles of the firm ones, where there are any.
  void add(const LayerRuns& solid, const LayerRuns& firm, const LayerLight* light);
  /// Once all layers are in; finds the ways down.
  void close();

  [[nodiscard]] std::uint32_t layers() const { return static_cast<std::uint32_t>(first_piece_.size()); }
  [[nodiscard]] PixelSize size() const { return below_.size(); }
  [[nodiscard]] std::span<const Piece> pieces() const { return pieces_; }
  [[nodiscard]] std::span<const Section> sections() const { return sections_; }
  /// Numbers of the first piece of a layer, and of the first section below it; `layers()` is allowed.
  [[nodiscard]] std::uint32_t first_piece(std::uint32_t layer) const;
  [[nodiscard]] std::uint32_t first_section(std::uint32_t layer) const;
  /// True for a piece that layers up to its own join to the platform.
  [[nodiscard]] bool stands(std::uint32_t piece) const { return stands_[piece] != 0; }
  [[nodiscard]] double pixel_mm2() const { return pitch_mm_ * pitch_mm_; }
  [[nodiscard]] double thickness_mm() const { return thickness_mm_; }
  static constexpr std::uint32_t kPlatform = ~std::uint32_t{0};
  /// The way down from a piece: through its widest section.
  struct Step {
    std::uint32_t next = kPlatform;  ///< piece
    double softness = 0;             ///< length over area of it, in 1/mm
  };
  [[nodiscard]] const Step& step_down(std::uint32_t piece) const { return steps_[piece]; }

 private:
  double pitch_mm_;
  double thickness_mm_;
  LayerRuns below_, firm_below_;
  std::vector<std::uint32_t> piece_below_, firm_piece_below_;  ///< by run of them
  std::vector<Piece> pieces_;
  std::vector<Section> sections_;
  std::vector<std::uint32_t> first_piece_, first_section_;
  std::vector<char> stands_;
  std::vector<Step> steps_;
};

}  // namespace telefab::fab
