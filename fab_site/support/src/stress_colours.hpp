// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <telefab/fab/support/support_plan.hpp>
#include <unordered_map>

namespace telefab::fab {

/// Colours of pins by what their tips bear at the worst moment over what they may: blue for little, yellow for half,
/// red for all of it, dark red beyond; grey for what bears no tip. The row is ColorBrewer's RdYlBu, which people who
/// are colour-blind tell apart.
class StressColours {
 public:
  using Rgb = std::array<double, 3>;
  /// `most_demand` > 0, stress over pull, is what a tip may bear.
  StressColours(const SupportPlan& plan, double most_demand);
  /// Of the pin that is nearest to a place from above, at that height above the platform.
  [[nodiscard]] Rgb at(Point2 place, double z_mm) const;
  /// Of a share of what may be borne, >= 0.
  [[nodiscard]] static Rgb of(double share);

 private:
  struct Spot {
    Point2 place;
    double share = 0;
  };
  using Cell = std::pair<int, int>;
  [[nodiscard]] static Cell cell_of(Point2 place);
  struct Hash {
    std::size_t operator()(const Cell& cell) const {
      return std::hash<std::int64_t>{}(std::int64_t{cell.first} << 32 ^ std::uint32_t(cell.second));
    }
  };
  std::unordered_map<Cell, std::vector<Spot>, Hash> spots_;  ///< along the pins
  double plates_mm_ = 0;                                     ///< height
};

}  // namespace telefab::fab
