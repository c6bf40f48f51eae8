// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <telefab/fab/mask/column_caps.hpp>

namespace telefab::fab {
namespace {

constexpr MaskFrame kFrame{{32, 32}, 1.0};

std::vector<Contour> box(double low, double high) {
  return {Contour::from_vertices({{low, low}, {high, low}, {high, high}, {low, high}}).value()};
}

/// White cures two layers deep.
MaskLight light() {
  MaskLight light;
  light.white = std::exp(1.0);
  light.layer_mm = 0.1;
  light.penetration_mm = 0.2;
  return light;
}

struct Print {
  std::vector<std::vector<Contour>> part, supports;

  /// Caps of a layer in row y.
  [[nodiscard]] std::vector<std::uint8_t> caps(std::size_t n, std::uint32_t y) const {
    const CapTable table{light(), 12};
    std::vector<SolidRows> solid;
    for (std::size_t i = 0; i < part.size(); ++i)
      solid.emplace_back(part[i], i < supports.size() ? supports[i] : std::vector<Contour>{}, kFrame);
    std::vector<const SolidRows*> below, above;
    for (std::size_t k = 1; k <= static_cast<std::size_t>(table.reach()) && k <= n; ++k) below.push_back(&solid[n - k]);
    for (std::size_t k = 1; k <= 12 && n + k < solid.size(); ++k) above.push_back(&solid[n + k]);
    const LayerCaps caps{table, solid[n], below, above, n < static_cast<std::size_t>(table.reach())};
    std::vector<std::uint8_t> row(kFrame.size.width_px, 77);
    return caps.fill(y, row) ? row : std::vector<std::uint8_t>{};
  }
};

/// Ten layers of nothing, then a body whose lowest layer reaches some pixels beyond the rest.
Print foot(double beyond) {
  Print print;
  print.part.assign(10, {});
  print.part.push_back(box(10 - beyond, 22 + beyond));
  print.part.resize(30, box(10, 22));
  return print;
}

TEST(LayerCaps, CapNothingOfAColumnThatStandsOnThePlatform) {
  Print print;
  print.part.assign(20, box(6, 26));
  for (std::size_t n = 0; n < 20; ++n) EXPECT_TRUE(print.caps(n, 16).empty());
}

TEST(LayerCaps, KeepARimDarkThatWouldCureBeforeTheBodyItHangsOn) {
  const auto caps = foot(2).caps(10, 16);
  ASSERT_FALSE(caps.empty());
  for (std::size_t x = 8; x < 24; ++x) EXPECT_EQ(caps[x], 0) << x;
}

TEST(LayerCaps, LightARimThatIsWideEnoughToCureWell) {
  const auto caps = foot(4).caps(10, 16);
  ASSERT_FALSE(caps.empty());
  for (std::size_t x = 6; x < 26; ++x) EXPECT_EQ(caps[x] > 100, x < 10 || x >= 22) << x;
}

TEST(LayerCaps, LightARimThatAPinHolds) {
  Print print = foot(2);
  print.supports.assign(10, box(8, 9));
  const auto caps = print.caps(10, 8);
  ASSERT_FALSE(caps.empty());
  EXPECT_EQ(caps[8], 255);  // over the pin
  EXPECT_GT(caps[9], 100);  // the rim beside it, one layer thin: what cures one layer
  EXPECT_GT(caps[23], 100);
  EXPECT_EQ(print.caps(10, 16)[12], 0) << "the body lies deep enough for the light of later layers";
}

TEST(LayerCaps, DoNotCapWhatStandsOnASupportHoweverThin) {
  Print print;
  print.part.assign(10, {});
  print.part.resize(30, box(6, 26));
  print.supports.assign(10, {});
  print.supports[9] = box(14, 18);
  const auto caps = print.caps(10, 16);
  ASSERT_FALSE(caps.empty());
  for (std::size_t x = 14; x < 18; ++x) EXPECT_EQ(caps[x], 255) << x;
  EXPECT_EQ(caps[10], 0);
}

TEST(LayerCaps, LeavePixelsAloneWhereNothingIsSolid) {
  const auto caps = foot(2).caps(10, 16);
  ASSERT_FALSE(caps.empty());
  EXPECT_EQ(caps[2], 255);
  EXPECT_EQ(caps[30], 255);
}

}  // namespace
}  // namespace telefab::fab
