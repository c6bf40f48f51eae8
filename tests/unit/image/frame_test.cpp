// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <telefab/image/frame.hpp>

namespace telefab {
namespace {

Image plain(std::uint32_t width, std::uint32_t height) {
  return {width, height, 3, std::vector<std::uint8_t>(std::size_t{width} * height * 3, 77)};
}

PictureCaption caption() {
  PictureCaption c{"Größe.ply", "machine-a", {10, 20, 30}, "layer 12, z = 1.80 mm", {}, 8, axes_of(usual_viewpoint())};
  for (int i = 0; i < 12; ++i) c.legend.push_back({{200, 40, 20}, "entry " + std::to_string(i), LegendMark::Area});
  return c;
}

bool has_ink(const Image& image, std::uint32_t from_row, std::uint32_t to_row) {
  const auto at = [&](std::uint32_t row) { return image.pixels.begin() + 3 * std::ptrdiff_t{row} * image.width_px; };
  return std::any_of(at(from_row), at(to_row), [](std::uint8_t v) { return v < 100; });
}

TEST(Frame, KeepsThePictureAndAddsTitleLegendBarAndAxes) {
  const Image framed_picture = framed(plain(900, 500), caption());
  EXPECT_EQ(framed_picture.width_px, 900U);
  EXPECT_GT(framed_picture.height_px, 500U + 64 + 64);
  EXPECT_TRUE(has_ink(framed_picture, 0, 60)) << "the title";
  EXPECT_TRUE(has_ink(framed_picture, framed_picture.height_px - 60, framed_picture.height_px)) << "bar and axes";
  const auto inside = framed_picture.pixels.begin() + 3 * (std::ptrdiff_t{64} * 900);
  EXPECT_TRUE(std::all_of(inside + 3 * 900, inside + 3 * std::ptrdiff_t{900} * 499, [](auto v) { return v == 77; }));
}

TEST(Frame, GrowsWithALegendThatNeedsMoreRows) {
  PictureCaption few = caption();
  few.legend.resize(1);
  EXPECT_LT(framed(plain(900, 500), few).height_px, framed(plain(900, 500), caption()).height_px);
  EXPECT_GT(framed(plain(100, 100), few).width_px, 600U) << "a small picture gets room for its title";
}

TEST(Frame, CutsOffATitleThatIsTooLong) {
  PictureCaption c = caption();
  c.part = std::string(4000, 'w');
  EXPECT_EQ(framed(plain(900, 500), c).width_px, 900U);
}

TEST(Frame, DrawsTheSameBytesEveryTime) {
  EXPECT_EQ(framed(plain(300, 200), caption()), framed(plain(300, 200), caption()));
}

TEST(RoundLength, IsOneTwoOrFiveTimesAPowerOfTen) {
  for (const auto& [most, length] :
       {std::pair{1.0, 1.0}, {1.9, 1.0}, {4.99, 2.0}, {70.0, 50.0}, {0.03, 0.02}, {1e-3, 1e-3}})
    EXPECT_NEAR(round_length(most), length, 1e-9 * length) << most;
}

TEST(Viewpoint, HasThreeAxesSquareToEachOther) {
  const Viewpoint v = viewpoint_from(25, 30);
  const auto dot = [](const auto& a, const auto& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  for (const auto* axis : {&v.right, &v.up, &v.away}) EXPECT_NEAR(dot(*axis, *axis), 1, 1e-12);
  EXPECT_NEAR(dot(v.right, v.up), 0, 1e-12);
  EXPECT_NEAR(dot(v.right, v.away), 0, 1e-12);
  EXPECT_NEAR(dot(v.up, v.away), 0, 1e-12);
  EXPECT_GT(v.up[2], 0);
  EXPECT_LT(v.away[2], 0) << "from above";
}

}  // namespace
}  // namespace telefab
