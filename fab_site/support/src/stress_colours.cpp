// SPDX-License-Identifier: GPL-3.0-or-later
#include "stress_colours.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telefab::fab {
namespace {

constexpr double kCell_mm = 3, kStep_mm = 0.5;
constexpr double kPlate = 1.1;  ///< layers need not end where a plate does
constexpr StressColours::Rgb kNoTip{150, 152, 158};
constexpr std::array<StressColours::Rgb, 6> kRow{
    {{69, 117, 180}, {145, 191, 219}, {254, 224, 144}, {252, 141, 89}, {215, 48, 39}, {110, 0, 20}}};
constexpr std::array<double, 6> kShares{0, 0.3, 0.55, 0.8, 1, 1.3};

}  // namespace

StressColours::Cell StressColours::cell_of(Point2 place) {
  return {static_cast<int>(std::floor(place.x_mm / kCell_mm)), static_cast<int>(std::floor(place.y_mm / kCell_mm))};
}

StressColours::StressColours(const SupportPlan& plan, double most_demand) {
  for (const Anchor& a : plan.anchors()) {
    // Where its arm leans, all along.
    const double reach_mm = std::hypot(a.place.x_mm - a.foot.x_mm, a.place.y_mm - a.foot.y_mm);
    const int steps = std::max(1, static_cast<int>(std::ceil(reach_mm / kStep_mm)));
    for (int i = 0; i <= steps; ++i) {
      const double s = static_cast<double>(i) / steps;
      const Point2 place{std::lerp(a.foot.x_mm, a.place.x_mm, s), std::lerp(a.foot.y_mm, a.place.y_mm, s)};
      spots_[cell_of(place)].push_back({place, a.demand / most_demand});
    }
  }
  for (const Plate& plate : plan.structure().plates) plates_mm_ = std::max(plates_mm_, plate.height_mm);
}

StressColours::Rgb StressColours::at(Point2 place, double z_mm) const {
  if (z_mm <= kPlate * plates_mm_) return kNoTip;
  const Cell here = cell_of(place);
  double nearest = std::numeric_limits<double>::infinity(), share = 0;
  for (int dx = -1; dx <= 1; ++dx)
    for (int dy = -1; dy <= 1; ++dy) {
      const auto spots = spots_.find({here.first + dx, here.second + dy});
      if (spots == spots_.end()) continue;
      for (const Spot& spot : spots->second) {
        const double d = std::hypot(spot.place.x_mm - place.x_mm, spot.place.y_mm - place.y_mm);
        if (d < nearest) nearest = d, share = spot.share;
      }
    }
  return std::isfinite(nearest) ? of(share) : kNoTip;
}

StressColours::Rgb StressColours::of(double share) {
  const double s = std::clamp(share, kShares.front(), kShares.back());
  std::size_t i = 1;
  while (i + 1 < kShares.size() && s > kShares[i]) ++i;
  const double t = (s - kShares[i - 1]) / (kShares[i] - kShares[i - 1]);
  Rgb out{};
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = std::lerp(kRow[i - 1][k], kRow[i][k], t);
  return out;
}

}  // namespace telefab::fab
