// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <telefab/image/canvas.hpp>

namespace telefab {
namespace {

std::uint8_t red_at(const Image& image, std::uint32_t x, std::uint32_t y) {
  return image.pixels[3 * (std::size_t{y} * image.width_px + x)];
}

TEST(Canvas, FillsARingAndLeavesItsHole) {
  Canvas canvas{40, 40, {}};
  const std::vector<std::vector<PixelPoint>> rings{{{5, 5}, {35, 5}, {35, 35}, {5, 35}},
                                                   {{15, 15}, {15, 25}, {25, 25}, {25, 15}}};
  canvas.fill(rings, {255, 0, 0});
  const Image image = canvas.image();
  EXPECT_EQ(red_at(image, 10, 10), 255);
  EXPECT_EQ(red_at(image, 20, 20), 0);
  EXPECT_EQ(red_at(image, 2, 2), 0);
}

TEST(Canvas, TakesAnythingOutsideOrNotFinite) {
  Canvas canvas{10, 10, {}};
  const double huge = 1e300;
  const double infinity = std::numeric_limits<double>::infinity();
  canvas.line({-huge, 0}, {infinity, 5}, {255, 255, 255}, 1);
  canvas.disc({5, 5}, huge, {9, 9, 9});
  canvas.text({huge, -huge}, "out\xff", {1, 1, 1}, 12);
  canvas.paste({2, 2, 1, {1, 2, 3, 4}}, {-1, -1}, 4, 4);
  EXPECT_EQ(canvas.image().pixels.size(), 300U);
}

TEST(ShrunkTo, KeepsShapeAndMeanAndEnlargesNothing) {
  Image wide{400, 100, 1, std::vector<std::uint8_t>(40000)};
  for (std::size_t i = 0; i < wide.pixels.size(); ++i) wide.pixels[i] = i % 400 < 200 ? 0 : 200;
  const Image small = shrunk_to(wide, 40);
  EXPECT_EQ(small.width_px, 40U);
  EXPECT_EQ(small.height_px, 10U);
  ASSERT_EQ(small.pixels.size(), 400U);
  EXPECT_EQ(small.pixels[5 * 40 + 10], 0);
  EXPECT_EQ(small.pixels[5 * 40 + 30], 200);
  EXPECT_EQ(shrunk_to(wide, 400), wide);
  // Shrunk before or by the sheet: the same picture.
  const std::string label = "a";
  EXPECT_EQ(contact_sheet({&small, 1}, {&label, 1}, 1, 40), contact_sheet({&wide, 1}, {&label, 1}, 1, 40));
}

TEST(ContactSheet, ShowsEveryTile) {
  const std::vector<Image> tiles(5, Image{4, 4, 1, std::vector<std::uint8_t>(16, 200)});
  const std::vector<std::string> labels{"0", "1", "2", "3", "4"};
  const Image sheet = contact_sheet(tiles, labels, 3, 32);
  EXPECT_EQ(sheet.width_px, 3 * 40 + 8U);
  EXPECT_EQ(red_at(sheet, 8 + 16, 8 + 16), 200);
  EXPECT_EQ(red_at(sheet, 8 + 40 + 16, 8 + 62 + 16), 200);
  EXPECT_NE(red_at(sheet, 8 + 80 + 16, 8 + 62 + 16), 200);
}

}  // namespace
}  // namespace telefab
