// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/geometry/layer.hpp>

namespace telefab {
namespace {

StackHeader header(std::uint32_t layers) {
  StackHeader h;
  h.machine = "m";
  h.layer_thickness_mm = 0.1;
  h.pixel_pitch_mm = 0.05;
  h.layer_count = layers;
  h.bounds = {{0, 0}, {10, 10}};
  return h;
}

Layer square(std::uint32_t index, double side = 1) {
  Layer layer;
  layer.index = LayerIndex{index};
  layer.z_mm = cut_height_mm(layer.index, 0.1);
  layer.contours = {Contour::from_vertices({{0, 0}, {side, 0}, {side, side}, {0, side}}).value()};
  return layer;
}

TEST(LayerStack, AcceptsLayersInOrderInsideTheBounds) {
  EXPECT_TRUE(LayerStack::from_layers(header(2), {square(0), square(1)}));
}

TEST(LayerStack, RefusesAMissingARepeatedAndAMisplacedLayer) {
  EXPECT_FALSE(LayerStack::from_layers(header(2), {square(0)}));
  EXPECT_FALSE(LayerStack::from_layers(header(2), {square(0), square(0)}));
  EXPECT_FALSE(LayerStack::from_layers(header(2), {square(1), square(0)}));
}

TEST(LayerStack, RefusesAVertexOutsideTheBounds) {
  const auto stack = LayerStack::from_layers(header(1), {square(0, 11)});
  ASSERT_FALSE(stack);
  EXPECT_NE(stack.error().what.find("layer 0"), std::string::npos);
}

TEST(LayerStack, ChangesItsDigestWithAnyVertexAndWithTheCertificate) {
  const auto a = LayerStack::from_layers(header(1), {square(0)}).value();
  const auto b = LayerStack::from_layers(header(1), {square(0, 1.0000000001)}).value();
  Layer flagged = square(0);
  flagged.certificate.flag({DoubtReason::ContoursCross});
  const auto c = LayerStack::from_layers(header(1), {flagged}).value();
  EXPECT_NE(digest_of(a), digest_of(b));
  EXPECT_NE(digest_of(a), digest_of(c));
}

TEST(SortedCanonically, GivesTheSameOrderWhereverARingStarts) {
  const auto a = Contour::from_vertices({{0, 0}, {1, 0}, {1, 1}}).value();
  const auto a_turned = Contour::from_vertices({{1, 1}, {0, 0}, {1, 0}}).value();
  const auto b = Contour::from_vertices({{5, 5}, {6, 5}, {6, 6}}).value();
  EXPECT_EQ(sorted_canonically({a, b}), sorted_canonically({b, a_turned}));
}

}  // namespace
}  // namespace telefab
