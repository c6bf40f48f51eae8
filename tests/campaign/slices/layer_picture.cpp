// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_picture.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace telefab::campaign {
namespace {

std::string_view colour_of(SurfaceClass kind) {
  switch (kind) {
    case SurfaceClass::Completed:
      return "orange";
    case SurfaceClass::Doubtful:
      return "red";
    default:
      return "black";
  }
}

}  // namespace

std::string picture_of(const Layer& layer, std::span<const std::array<Point2, 2>> truth) {
  Point2 low{1e9, 1e9}, high{-1e9, -1e9};
  std::string lines;
  const auto line = [&](Point2 a, Point2 b, std::string_view colour, double width) {
    for (const Point2& p : {a, b}) {
      low = {std::min(low.x_mm, p.x_mm), std::min(low.y_mm, p.y_mm)};
      high = {std::max(high.x_mm, p.x_mm), std::max(high.y_mm, p.y_mm)};
    }
    lines += fmt::format(
        "<line x1=\"{:.3f}\" y1=\"{:.3f}\" x2=\"{:.3f}\" y2=\"{:.3f}\" stroke=\"{}\" stroke-width=\"{}\"/>\n", a.x_mm,
        -a.y_mm, b.x_mm, -b.y_mm, colour, width);
  };
  for (const auto& [a, b] : truth) line(a, b, "deepskyblue", 0.35);
  for (const Contour& ring : layer.contours) {
    const auto v = ring.vertices();
    std::size_t edge = 0;
    for (const SurfaceRun& run : one_an_edge(ring.runs(), v.size())) {
      line(v[edge], v[(edge + 1) % v.size()], colour_of(run.kind), 0.12);
      ++edge;
    }
  }
  const double margin = 1, scale = 1400 / std::max({high.x_mm - low.x_mm, high.y_mm - low.y_mm, 1.0});
  const double width = high.x_mm - low.x_mm + 2 * margin, depth = high.y_mm - low.y_mm + 2 * margin;
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.0f}\" height=\"{:.0f}\" viewBox=\"{:.3f} {:.3f} {:.3f} "
      "{:.3f}\">\n{}</svg>\n",
      scale * width, scale * depth, low.x_mm - margin, -high.y_mm - margin, width, depth, lines);
}

}  // namespace telefab::campaign
