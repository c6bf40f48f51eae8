// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <numbers>
#include <string>
#include <telefab/fab/region/region.hpp>
#include <utility>
#include <vector>

namespace telefab::fab::shapes {

/// A region with the name it has in tables. Lengths are in units of an anchor distance of 1 mm.
struct Named {
  std::string name;
  Region region;
};

using Ring = std::vector<Point2>;

inline Region made(std::vector<Ring> rings) {
  std::vector<GridRing> grid;
  for (const Ring& ring : rings) {
    GridRing g;
    for (const Point2& p : ring) g.push_back(to_grid(p));
    grid.push_back(std::move(g));
  }
  return Region::from_rings(grid, true).value_or(Region{});
}

/// r(angle) = base + sum of waves; `turns` vertices.
inline Ring wavy(double x, double y, double base, std::vector<std::pair<int, double>> waves, double stretch = 1) {
  Ring ring;
  for (int i = 0; i < 360; ++i) {
    const double a = 2 * std::numbers::pi * i / 360;
    double r = base;
    for (const auto& [n, height] : waves) r += height * std::sin(n * a + n);
    ring.push_back({x + stretch * r * std::cos(a), y + r * std::sin(a)});
  }
  return ring;
}

inline Ring box(double x0, double y0, double x1, double y1) { return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}; }

inline Ring star(int points, double outer, double inner) {
  Ring ring;
  for (int i = 0; i < 2 * points; ++i) {
    const double a = std::numbers::pi * i / points, r = i % 2 ? inner : outer;
    ring.push_back({r * std::cos(a), r * std::sin(a)});
  }
  return ring;
}

inline Ring comb(int teeth, double pitch, double width, double length, double back) {
  Ring ring{{0, 0}, {(teeth - 1) * pitch + width, 0}};
  for (int i = teeth - 1; i >= 0; --i) {
    ring.push_back({i * pitch + width, back + length});
    ring.push_back({i * pitch, back + length});
    if (i > 0) {
      ring.push_back({i * pitch, back});
      ring.push_back({(i - 1) * pitch + width, back});
    }
  }
  return ring;
}

/// The twelve irregular regions of the anchors table.
inline std::vector<Named> twelve() {
  std::vector<Named> all;
  const auto add = [&](std::string name, std::vector<Ring> rings) {
    all.push_back({std::move(name), made(std::move(rings))});
  };
  add("thin strip 30 x 0.4", {{{0, 0}, {30, 0.7}, {30, 1.1}, {0, 0.4}}});
  add("L, arms 2.4", {{{0, 0}, {12, 0}, {12, 2.4}, {2.4, 2.4}, {2.4, 10}, {0, 10}}});
  add("ring 6/4", {wavy(0, 0, 6, {}), wavy(0, 0, 4, {})});
  add("comb, 7 teeth", {comb(7, 2.2, 0.9, 6, 1.5)});
  add("star, 5 points", {star(5, 9, 3.5)});
  add("star, 11 points", {star(11, 8, 5)});
  add("blob 60", {wavy(0, 0, 4.2, {{2, 0.7}, {3, 0.6}, {5, 0.4}})});
  add("blob with holes 150", {wavy(0, 0, 7.5, {{2, 1}, {3, 0.8}, {7, 0.3}}), wavy(3, 1, 1.5, {}),
                              wavy(-3, -2, 1.2, {{3, 0.3}}), wavy(-1, 4, 0.8, {})});
  add("crescent", {wavy(0, 0, 7, {}), wavy(2.5, 0.5, 5.2, {})});
  add("islands", {wavy(0, 0, 1.6, {{3, 0.2}}), wavy(5, 1, 2.1, {{2, 0.3}}), box(9, -1, 9.6, 5), wavy(12, 3, 0.4, {})});
  add("large blob 300", {wavy(0, 0, 9.5, {{2, 1.2}, {3, 0.9}, {5, 0.5}, {9, 0.2}})});
  add("large 1000", {wavy(0, 0, 17.6, {{2, 1.6}, {3, 1.1}, {6, 0.6}})});
  return all;
}

}  // namespace telefab::fab::shapes
