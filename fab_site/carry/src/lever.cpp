// SPDX-License-Identifier: GPL-3.0-or-later
#include "lever.hpp"

#include <cmath>
#include <numbers>

namespace telefab::fab {

CutStress stress_of(std::span<const CutPart> parts, const Pull& pull) {
  double stiffness = 0, x = 0, y = 0, area = 0;
  for (const CutPart& part : parts) {
    stiffness += part.stiffness;
    x += part.stiffness * part.section->middle.x_mm;
    y += part.stiffness * part.section->middle.y_mm;
    area += part.section->area_mm2;
  }
  x /= stiffness, y /= stiffness;
  double xx = 0, xy = 0, yy = 0;
  for (const CutPart& part : parts) {
    const Section& s = *part.section;
    const double dx = s.middle.x_mm - x, dy = s.middle.y_mm - y;
    xx += part.stiffness * (dx * dx + s.xx);
    xy += part.stiffness * (dx * dy + s.xy);
    yy += part.stiffness * (dy * dy + s.yy);
  }
  const double det = xx * yy - xy * xy;
  /// How the body turns under a moment.
  const auto turn = [&](double mx, double my) { return Point2{(yy * mx - xy * my) / det, (xx * my - xy * mx) / det}; };

  CutStress stress;
  stress.mean = pull.area_mm2 / area;
  const int directions = pull.sideways_share > 0 ? 8 : 1;
  for (int i = 0; i < directions; ++i) {
    const double angle = i * std::numbers::pi / 4;
    const Point2 up = turn(pull.middle.x_mm - x, pull.middle.y_mm - y);
    const Point2 push = pull.sideways_share > 0
                            ? turn(pull.sideways_share * std::cos(angle), pull.sideways_share * std::sin(angle))
                            : Point2{};
    for (std::size_t p = 0; p < parts.size(); ++p) {
      const CutPart& part = parts[p];
      const Section& s = *part.section;
      const Point2 tilt{up.x_mm + part.below_mm * push.x_mm, up.y_mm + part.below_mm * push.y_mm};
      const double share = pull.area_mm2 * part.stiffness / s.area_mm2;
      const double middle = share * (1 / stiffness + (s.middle.x_mm - x) * tilt.x_mm + (s.middle.y_mm - y) * tilt.y_mm);
      const double rim = middle + share * s.along(tilt);
      if (middle > stress.lever) stress.lever = middle, stress.lever_at = p;
      if (rim > stress.bending) stress.bending = rim, stress.bending_at = p;
    }
  }
  return stress;
}

}  // namespace telefab::fab
