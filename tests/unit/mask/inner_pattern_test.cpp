// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cmath>
#include <random>
#include <telefab/fab/mask/inner_pattern.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using Bitmap = std::vector<std::vector<bool>>;  // by row

Bitmap random_bitmap(std::uint64_t seed, int rows, int columns) {
  std::mt19937_64 rng{seed};
  Bitmap map(static_cast<std::size_t>(rows), std::vector<bool>(static_cast<std::size_t>(columns)));
  for (int blot = 0; blot < 6; ++blot) {
    const auto y0 = rng() % map.size(), x0 = rng() % map[0].size(), h = rng() % 20, w = rng() % 30;
    for (auto y = y0; y < std::min(map.size(), y0 + h); ++y)
      for (auto x = x0; x < std::min(map[0].size(), x0 + w); ++x) map[y][x] = true;
  }
  return map;
}

PixelRuns runs_of(const Bitmap& map) {
  PixelRuns runs;
  for (const auto& row : map) {
    runs.begin_row();
    for (std::size_t x = 0; x < row.size();) {
      while (x < row.size() && !row[x]) ++x;
      const std::size_t first = x;
      while (x < row.size() && row[x]) ++x;
      if (x > first) runs.add({static_cast<std::int32_t>(first), static_cast<std::int32_t>(x)});
    }
  }
  return runs;
}

template <class Keep>
PixelRuns where(const Bitmap& map, Keep keep) {
  Bitmap kept = map;
  for (int y = 0; y < static_cast<int>(map.size()); ++y)
    for (int x = 0; x < static_cast<int>(map[0].size()); ++x)
      kept[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)] = keep(x, y);
  return runs_of(kept);
}

bool at(const Bitmap& map, int x, int y) {
  return y >= 0 && x >= 0 && y < static_cast<int>(map.size()) && x < static_cast<int>(map[0].size()) &&
         map[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)];
}

class PixelRunsProperty : public testing::TestWithParam<std::uint64_t> {};

TEST_P(PixelRunsProperty, OperationsAreThoseOfEveryPixel) {
  const Bitmap a = random_bitmap(GetParam(), 40, 50), b = random_bitmap(GetParam() + 1000, 40, 50);
  const PixelRuns x = runs_of(a), y = runs_of(b);
  EXPECT_EQ(common(x, y), where(a, [&](int c, int r) { return at(a, c, r) && at(b, c, r); }));
  EXPECT_EQ(common(x, y, 3), where(a, [&](int c, int r) { return at(a, c, r) && at(b, c, r + 3); }));
  EXPECT_EQ(without(x, y), where(a, [&](int c, int r) { return at(a, c, r) && !at(b, c, r); }));
  EXPECT_EQ(united(x, y), where(a, [&](int c, int r) { return at(a, c, r) || at(b, c, r); }));
  for (const int by : {0, 1, 2, 3, 5, 8})
    EXPECT_EQ(shrunk(x, static_cast<std::uint32_t>(by)), where(a,
                                                               [&](int c, int r) {
                                                                 for (int j = -by; j <= by; ++j)
                                                                   for (int i = -by; i <= by; ++i)
                                                                     if (!at(a, c + i, r + j)) return false;
                                                                 return true;
                                                               }))
        << by;
}
INSTANTIATE_TEST_SUITE_P(Seeds, PixelRunsProperty, testing::Range<std::uint64_t>(0, 20));

const MaskFrame kFrame{{120, 100}, 0.1};

MaskLight light_of(double white) {
  MachineProfile machine;
  machine.platform = {12, 10, 50};
  machine.projection.pixel_pitch_mm = 0.1;
  machine.projection.irradiance_mw_per_cm2 = 10;
  machine.layers.thickness_mm = 0.1;
  machine.layers.exposure_s = white;
  machine.resin.critical_dose_mj_per_cm2 = 10;
  machine.resin.penetration_mm = 0.2;
  return mask_light(machine).value();
}

InnerPattern pattern_of(InnerPattern::Kind kind) {
  InnerPattern pattern;
  pattern.kind = kind;
  pattern.cell_mm = 0.3;
  return pattern;
}

std::vector<SolidRows> block(std::size_t layers, bool with_support = false) {
  const std::vector ring{Contour::from_vertices({{1, 1}, {9, 1}, {9, 8}, {1, 8}}).value()};
  std::vector<Contour> pin;
  if (with_support) pin.push_back(Contour::from_vertices({{9, 4}, {10, 4}, {10, 5}, {9, 5}}).value());
  std::vector<SolidRows> rows;
  for (std::size_t i = 0; i < layers; ++i) rows.emplace_back(ring, pin, kFrame);
  return rows;
}

TEST(InnerPattern, TheInsideOfABlockIsAShellAwayFromItsSidesTopAndBottom) {
  const PatternMaker maker = PatternMaker::make(pattern_of(InnerPattern::Kind::Checker), light_of(4), kFrame).value();
  ASSERT_EQ(maker.shell_layers(), 10U);
  for (const bool with_support : {false, true}) {  // a support is no part of it
    const auto cores = maker.cores(block(30, with_support));
    for (std::size_t i = 0; i < 30; ++i) {
      if (i < 10 || i >= 20) {
        EXPECT_TRUE(cores[i].empty()) << i;
        continue;
      }
      for (std::uint32_t y = 0; y < 100; ++y) {
        const auto row = cores[i].row(y);
        ASSERT_EQ(row.size(), y >= 20 && y < 70 ? 1U : 0U) << y;
        if (!row.empty()) {
          EXPECT_EQ(row[0], (PixelRun{20, 80}));
        }
      }
    }
  }
}

TEST(InnerPattern, ACheckerLightsEveryPixelInOneOfTwoLayersAndHalfOfThemInEach) {
  const PatternMaker maker = PatternMaker::make(pattern_of(InnerPattern::Kind::Checker), light_of(4), kFrame).value();
  const auto cores = maker.cores(block(30));
  std::vector<std::uint8_t> even(120), odd(120);
  EXPECT_FALSE(maker.darken(cores[14], 14, 5, false, even));  // the shell has no caps
  int lit = 0;
  for (std::uint32_t y = 20; y < 70; ++y) {
    ASSERT_TRUE(maker.darken(cores[14], 14, y, false, even));
    ASSERT_TRUE(maker.darken(cores[15], 15, y, false, odd));
    for (std::size_t x = 0; x < 120; ++x) {
      const bool inside = x >= 20 && x < 80;
      EXPECT_EQ(even[x] + odd[x], inside ? 255 : 510);
      lit += inside && even[x] == 255;
    }
  }
  EXPECT_NEAR(lit, 60 * 50 / 2, 100);
}

TEST(InnerPattern, ACoreGetsItsShareAndKeepsLowerCaps) {
  const PatternMaker maker = PatternMaker::make(pattern_of(InnerPattern::Kind::ShellCore), light_of(4), kFrame).value();
  const auto cores = maker.cores(block(30));
  std::vector<std::uint8_t> caps(120, 255);
  caps[50] = 7;
  ASSERT_TRUE(maker.darken(cores[15], 15, 40, true, caps));
  EXPECT_EQ(caps[19], 255);
  EXPECT_EQ(caps[20], 179);  // 0.7
  EXPECT_EQ(caps[50], 7);
}

TEST(InnerPattern, IsRefusedWhereTheInsideWouldNotCureOrTheShellIsTooThinAndSaysWhatWouldDo) {
  const auto refusal = [](const InnerPattern& pattern, double white) {
    const auto made = PatternMaker::make(pattern, light_of(white), kFrame);
    EXPECT_FALSE(made);
    return made ? std::string{} : made.error().what;
  };
  EXPECT_THAT(refusal(pattern_of(InnerPattern::Kind::Checker), 1.7), HasSubstr("--cure-depth 1.2"));
  EXPECT_TRUE(PatternMaker::make(pattern_of(InnerPattern::Kind::Checker), light_of(1.85), kFrame));
  InnerPattern core = pattern_of(InnerPattern::Kind::ShellCore);
  core.core_share = 0.3;
  EXPECT_THAT(refusal(core, 4), HasSubstr("needs a dose of 5.77 Ec and gets 4.00"));
  InnerPattern thin = pattern_of(InnerPattern::Kind::Checker);
  thin.shell_mm = 0.5;
  EXPECT_THAT(refusal(thin, 4), HasSubstr("0.93 mm and more are possible"));
  for (const auto change : {+[](InnerPattern& p) { p.shell_mm = 0; }, +[](InnerPattern& p) { p.cell_mm = -1; },
                            +[](InnerPattern& p) { p.core_share = std::nan(""); }}) {
    InnerPattern bad;
    change(bad);
    EXPECT_FALSE(bad.validate());
  }
}

TEST(InnerPattern, NamesAreReadBack) {
  for (const auto kind : {InnerPattern::Kind::Solid, InnerPattern::Kind::Checker, InnerPattern::Kind::ShellCore})
    EXPECT_EQ(inner_pattern_from_name(name_of(kind)).value(), kind);
  EXPECT_THAT(inner_pattern_from_name("honeycomb").error().what, HasSubstr("solid, checker, shell-core"));
}

}  // namespace
}  // namespace telefab::fab
