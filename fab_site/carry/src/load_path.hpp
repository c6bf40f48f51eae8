// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <telefab/fab/carry/carry_watch.hpp>
#include <telefab/fab/verify/hollow_watch.hpp>
#include <vector>

namespace telefab::fab {

/// A connected piece of one layer.
struct Piece {
  std::uint32_t layer = 0;
  std::int64_t pixels = 0;
  std::int64_t pulled = 0;  ///< when the layer has just been exposed, in kPullUnits of a pixel
  Point2 pulled_at;         ///< mm; the middle of that
  Point2 middle;            ///< mm
};

/// Pull is counted in whole parts of that on a pixel, so that flows are exact.
constexpr std::int64_t kPullUnits = 64;

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
  explicit LoadPath(const CarryOptions& options) : options_{options} {}
  /// Bodies are of all solid pixels; areas and middles of the firm ones, where there are any. What is pulled is so
  /// `pull_share` times as hard as areas alone say.
  void add(const LayerRuns& solid, const LayerRuns& firm, const LayerLight* light, double pull_share);
  /// Once all layers are in; finds the ways down.
  void close();
  /// The same print, closed, without some sections, given by their numbers in any order. `kept`: the number here of
  /// each section there.
  [[nodiscard]] LoadPath without(std::span<const std::uint32_t> torn, std::vector<std::uint32_t>& kept) const;

  [[nodiscard]] std::uint32_t layers() const { return static_cast<std::uint32_t>(first_piece_.size()); }
  [[nodiscard]] PixelSize size() const { return below_.size(); }
  [[nodiscard]] std::span<const Piece> pieces() const { return pieces_; }
  [[nodiscard]] std::span<const Section> sections() const { return sections_; }
  /// Numbers of the first piece of a layer, and of the first section below it; `layers()` is allowed.
  [[nodiscard]] std::uint32_t first_piece(std::uint32_t layer) const;
  [[nodiscard]] std::uint32_t first_section(std::uint32_t layer) const;
  /// True for a piece that layers up to its own join to the platform.
  [[nodiscard]] bool stands(std::uint32_t piece) const { return stands_[piece] != 0; }
  [[nodiscard]] double pixel_mm2() const { return options_.pitch_mm * options_.pitch_mm; }
  /// As so much area is pulled.
  [[nodiscard]] double pull_mm2(std::int64_t units) const {
    return static_cast<double>(units) * (pixel_mm2() / kPullUnits);
  }
  /// Weight of a piece, in units of pull.
  [[nodiscard]] double weight_of(const Piece& piece) const {
    return options_.weight_share * kPullUnits * static_cast<double>(piece.pixels);
  }
  [[nodiscard]] double thickness_mm() const { return options_.thickness_mm; }
  static constexpr std::uint32_t kPlatform = ~std::uint32_t{0};
  /// The way down from a piece: through its widest section.
  struct Step {
    std::uint32_t next = kPlatform;  ///< piece
    double softness = 0;             ///< length over area of it, in 1/mm
  };
  [[nodiscard]] const Step& step_down(std::uint32_t piece) const { return steps_[piece]; }

 private:
  CarryOptions options_;
  HollowWatch hollows_{1};
  LayerRuns below_, firm_below_;
  std::vector<std::uint32_t> piece_below_, firm_piece_below_;  ///< by run of them
  std::vector<Piece> pieces_;
  std::vector<Section> sections_;
  std::vector<std::uint32_t> first_piece_, first_section_;
  std::vector<char> stands_;
  std::vector<Step> steps_;
};

}  // namespace telefab::fab
