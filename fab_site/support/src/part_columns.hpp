// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/fab/region/region.hpp>
#include <vector>

namespace telefab::fab {

/// The part as columns of a coarse grid: for every grid cell the runs of layers in which the part, grown by some
/// distance, may touch the cell. Errs towards "occupied" by at most 1.5 cells.
class PartColumns {
 public:
  /// `layers` bottom first; `grow_mm` >= 0. Cells so that the part's box has at most `cells` a side.
  PartColumns(std::span<const Region> layers, double grow_mm, double cell_mm);

  /// The highest occupied layer below `layer` in the column of the place; nothing if the column is free down to the
  /// platform. `layer` itself is not looked at.
  [[nodiscard]] std::optional<std::uint32_t> highest_below(Point2 place, std::int64_t layer) const;
  [[nodiscard]] bool occupied(Point2 place, std::int64_t layer) const;

 private:
  struct Run {
    std::uint32_t first, last;
  };
  [[nodiscard]] const std::vector<Run>* column(Point2 place) const;
  Point2 origin_;
  double cell_mm_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<std::vector<Run>> runs_;
};

}  // namespace telefab::fab
