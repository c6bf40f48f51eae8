// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
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

/// How dark a text makes a white canvas, summed over its pixels.
double ink_of(std::string_view text) {
  Canvas canvas{120, 40, {255, 255, 255}};
  canvas.text({5, 28}, text, {}, 14);
  double ink = 0;
  for (const std::uint8_t value : canvas.image().pixels) ink += 255 - value;
  return ink / 255 / 3;
}

TEST(CanvasText, ShowsLettersOfLatinGreekAndCyrillicAsTheyAre) {
  const double replacement = ink_of("\uFFFD");
  for (const char* letter : {"Ä", "ö", "ß", "é", "ç", "Ł", "ő", "ñ", "α", "Ω", "Ж", "я", "µ", "°", "€", "–", "²"}) {
    EXPECT_GT(ink_of(letter), 2) << letter;
    EXPECT_NE(ink_of(letter), replacement) << letter;
    EXPECT_NE(ink_of(letter), ink_of("?")) << letter;
  }
  EXPECT_GT(ink_of("Ö"), ink_of("O")) << "the dots are there";
}

TEST(CanvasText, ShowsThatACharacterIsMissingWhereTheFontHasNone) {
  EXPECT_EQ(ink_of("\u5B57"), ink_of("\uFFFD"));
  EXPECT_GT(ink_of("\u5B57"), 2);
}

TEST(CanvasText, ShowsControlsAndBrokenBytesAsQuestionMarks) {
  EXPECT_EQ(ink_of("a\x1B[31mb"), ink_of("a?[31mb"));
  EXPECT_EQ(ink_of("\u202Eabc"), ink_of("?abc"));
  EXPECT_EQ(ink_of("\xFF"), ink_of("?"));
}

TEST(CanvasText, IsAsWideAsItSays) {
  Canvas canvas{200, 40, {255, 255, 255}};
  canvas.text({10, 28}, "Größe 12 mm", {}, 12);
  const Image image = canvas.image();
  std::uint32_t last = 0;
  for (std::uint32_t y = 0; y < 40; ++y)
    for (std::uint32_t x = 0; x < 200; ++x)
      if (red_at(image, x, y) < 128) last = std::max(last, x);
  EXPECT_NEAR(last, 10 + text_width_px("Größe 12 mm", 12), 3);
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
