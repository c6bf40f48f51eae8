// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <telefab/fab/planning/print_view.hpp>

namespace telefab::fab {
namespace {

Contour square(double left, double front, double side) {
  return Contour::from_vertices(
             {{left, front}, {left + side, front}, {left + side, front + side}, {left, front + side}})
      .value();
}

struct Seen {
  int part = 0, support = 0, paper = 0;
};
/// What the pixels of a picture show: the part is blue, supports are amber, whatever light falls on them.
Seen seen_in(const Image& image) {
  Seen seen;
  for (std::size_t i = 0; i + 2 < image.pixels.size(); i += 3) {
    const int red = image.pixels[i], blue = image.pixels[i + 2];
    ++(red == 255 && blue == 255 ? seen.paper : blue > red ? seen.part : seen.support);
  }
  return seen;
}

/// Forty layers of 0.5 mm: a pillar of support below, the part of `side` mm above.
LayerViewer on_a_pillar(double side) {
  return [side](LayerIndex layer, const std::function<void(const ViewedLayer&)>& look) -> Result<void> {
    const Contour pillar = square(9, 9, 2), part = square(10 - side / 2, 10 - side / 2, side);
    const bool is_low = layer.count() < 20;
    look({(layer.count() + 0.5) * 0.5, is_low ? std::span<const Contour>{} : std::span{&part, 1},
          is_low ? std::span{&pillar, 1} : std::span<const Contour>{}});
    return {};
  };
}

TEST(PrintView, ShowsThePartAndItsSupportsInColoursOfTheirOwn) {
  const auto image = draw_print(LayerIndex{40}, on_a_pillar(8));
  ASSERT_TRUE(image);
  EXPECT_EQ(image->width_px, kViewWidth_px);
  EXPECT_EQ(image->height_px, kViewHeight_px);
  const Seen seen = seen_in(*image);
  EXPECT_GT(seen.part, 10000);
  EXPECT_GT(seen.support, 1000);
  EXPECT_GT(seen.paper, 10000);
}

TEST(PrintView, HidesWhatLiesBehindThePart) {
  const auto small = draw_print(LayerIndex{40}, on_a_pillar(2)), large = draw_print(LayerIndex{40}, on_a_pillar(40));
  ASSERT_TRUE(small && large);
  EXPECT_GT(seen_in(*small).support, 3000);
  // Seen from 30 degrees above, a roof of 40 mm hides a pillar of 10 mm in the middle below it.
  EXPECT_EQ(seen_in(*large).support, 0);
}

TEST(PrintView, IsBlankWhereNothingIsPrinted) {
  const auto nothing = [](LayerIndex, const std::function<void(const ViewedLayer&)>& look) -> Result<void> {
    look({});
    return {};
  };
  for (const std::uint32_t layers : {0U, 3U}) {
    const auto image = draw_print(LayerIndex{layers}, nothing);
    ASSERT_TRUE(image);
    EXPECT_EQ(seen_in(*image).paper, static_cast<int>(kViewWidth_px * kViewHeight_px));
  }
}

TEST(PrintView, LooksAtTheLastLayerAndAtFewOfMany) {
  std::vector<std::uint32_t> looked_at;
  const auto viewer = [&](LayerIndex layer, const std::function<void(const ViewedLayer&)>& look) -> Result<void> {
    looked_at.push_back(layer.count());
    look({});
    return {};
  };
  ASSERT_TRUE(draw_print(LayerIndex{5000}, viewer));
  EXPECT_LE(looked_at.size(), 2 * 402U);
  EXPECT_TRUE(std::ranges::find(looked_at, 4999U) != looked_at.end());
}

TEST(PrintView, FailsAsItsLayersDo) {
  const auto image = draw_print(LayerIndex{2}, [](LayerIndex, const auto&) -> Result<void> {
    return fail(ErrorCode::InvalidInput, "the layer is damaged");
  });
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().what, "the layer is damaged");
}

}  // namespace
}  // namespace telefab::fab
