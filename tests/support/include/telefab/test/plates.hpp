// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/geometry/contour.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::test {

/// Layers to measure speed with, as wide as a mask of pixels of a millimetre.
enum class Plate {
  Gears,  ///< eight gears with bores, some 4,000 vertices
  Holes,  ///< a sheet with some thousand round holes
  Blank,
};

namespace plates {

inline std::vector<Point2> gear(Point2 centre, double radius, int teeth) {
  std::vector<Point2> ring;
  const int steps = teeth * 16;
  for (int i = 0; i < steps; ++i) {
    const double angle = 2 * std::numbers::pi * i / steps;
    const double r = radius * (1 + 0.08 * std::tanh(4 * std::sin(teeth * angle)));
    ring.push_back({centre.x_mm + r * std::cos(angle), centre.y_mm + r * std::sin(angle)});
  }
  return ring;
}

}  // namespace plates

/// Outer rings and holes; `pitch_mm` scales them to other pixels.
inline std::vector<Contour> plate(Plate which, PixelSize size, double pitch_mm = 1) {
  std::vector<Contour> rings;
  const double w = size.width_px, h = size.height_px;
  const auto add = [&](std::vector<Point2> ring, bool hole) {
    if (hole) std::reverse(ring.begin(), ring.end());
    for (Point2& p : ring) p = {p.x_mm * pitch_mm, p.y_mm * pitch_mm};
    rings.push_back(Contour::from_vertices(std::move(ring)).value());
  };
  if (which == Plate::Gears)
    for (int y = 0; y < 2; ++y)
      for (int x = 0; x < 4; ++x) {
        const Point2 centre{w * (0.125 + 0.25 * x), h * (0.25 + 0.5 * y)};
        add(plates::gear(centre, w * 0.1, 24 + x), false);
        add(plates::gear(centre, w * 0.03, 7), true);
      }
  if (which == Plate::Holes) {
    add({{w * 0.02, h * 0.02}, {w * 0.98, h * 0.02}, {w * 0.98, h * 0.98}, {w * 0.02, h * 0.98}}, false);
    const double step = w / 80;
    for (double y = h * 0.05; y < h * 0.95; y += step)
      for (double x = w * 0.05; x < w * 0.95; x += step) add(plates::gear({x, y}, step * 0.3, 1), true);
  }
  return rings;
}

}  // namespace telefab::test
