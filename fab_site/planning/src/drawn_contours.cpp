// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/planning/drawn_contours.hpp>
#include <telefab/fab/region/region.hpp>

namespace telefab::fab {

namespace {

constexpr Millimetres kArcTolerance{0.001};

bool runs_clockwise(const GridRing& ring) {
  std::vector<Point2> places;
  for (const GridPoint& p : ring) places.push_back(to_mm(p));
  return signed_area_mm2(places) < 0;
}

/// The rings of a layer with their holes grown. There is at least one.
Result<std::vector<Contour>> grown(std::span<const Contour> rings, Millimetres growth) {
  const auto solid = Region::from_contours(rings);
  if (!solid) return tl::unexpected{solid.error()};
  std::vector<Region> holes;
  for (const GridRing& ring : solid->rings()) {
    if (!runs_clockwise(ring)) continue;
    const auto hole = Region::from_rings({&ring, 1}, true);
    if (!hole) return tl::unexpected{hole.error()};
    holes.push_back(*hole);
  }
  const Region inside = unite(holes);
  if (growth.count() < 0) {
    const Region smaller = offset(inside, growth, kArcTolerance);
    return unite(*solid, subtract(inside, smaller)).to_contours();
  }
  const Region filled = unite(*solid, inside);
  const Region skin = subtract(*solid, offset(filled, Millimetres{-growth.count()}, kArcTolerance));
  const Region cut = subtract(*solid, offset(inside, growth, kArcTolerance));
  const Region islands = intersect(*solid, inside);
  return unite(std::vector<Region>{cut, skin, islands}).to_contours();
}

bool has_hole(const Layer& layer) {
  return std::any_of(layer.contours.begin(), layer.contours.end(), [](const Contour& c) { return c.is_hole(); });
}

}  // namespace

Result<LayerStack> with_grown_holes(const LayerStack& stack, Millimetres growth) {
  if (!std::isfinite(growth.count())) return fail(ErrorCode::InvalidInput, "the growth of holes is not finite");
  if (growth.count() == 0) return stack;
  std::vector<Layer> layers(stack.layers().begin(), stack.layers().end());
  std::vector<Result<void>> done(layers.size());
  tbb::parallel_for(std::size_t{0}, layers.size(), [&](std::size_t i) {
    Layer& layer = layers[i];
    if (!has_hole(layer)) return;
    auto rings = grown(layer.contours, growth);
    if (!rings) {
      done[i] = fail_in(fmt::format("holes of layer {}", i), rings.error());
      return;
    }
    layer.contours = std::move(*rings);
    layer.certificate = {};
  });
  for (const auto& ok : done)
    if (!ok) return tl::unexpected{ok.error()};
  StackHeader header = stack.header();
  header.bounds.include(bounds_of(layers));  // the grid of regions rounds
  return LayerStack::from_layers(std::move(header), std::move(layers));
}

}  // namespace telefab::fab
