// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <telefab/fab/screen/packing.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;

constexpr std::array kPackings{PixelPacking::Grey, PixelPacking::Rgb, PixelPacking::Bgr, PixelPacking::Bits565,
                               PixelPacking::Bits555};
constexpr std::array kTurns{ScreenTurn::None, ScreenTurn::Quarter, ScreenTurn::Half, ScreenTurn::ThreeQuarters};
constexpr std::array kOptics{OpticsTurn::Normal, OpticsTurn::MirrorX, OpticsTurn::MirrorY, OpticsTurn::Rotate180};

struct Frame {
  std::vector<std::byte> bytes;
  std::size_t pitch = 0;
};

Frame frame_of(const PanelLayout& layout, std::size_t spare_bytes = 0, std::byte filler = std::byte{0xA5}) {
  const std::size_t pitch = std::size_t{layout.words.width_px} * bytes_per_word(layout.packing) + spare_bytes;
  return {std::vector<std::byte>(pitch * layout.words.height_px, filler), pitch};
}

std::uint32_t at(const Frame& f, std::size_t i) { return static_cast<std::uint32_t>(f.bytes[i]); }

/// What the panel shows for one word, its pixels from left to right, each from 0 to 1: as its data sheet has it.
std::vector<double> pixels_of(const Frame& f, std::size_t offset, PixelPacking packing) {
  const double blue = at(f, offset) / 255.0, green = at(f, offset + 1) / 255.0;
  if (packing == PixelPacking::Bits565 || packing == PixelPacking::Bits555) {
    const std::uint32_t word = at(f, offset) | at(f, offset + 1) << 8;
    if (packing == PixelPacking::Bits565) return {(word >> 11) / 31.0, (word >> 5 & 63) / 63.0, (word & 31) / 31.0};
    return {(word >> 10 & 31) / 31.0, (word >> 5 & 31) / 31.0, (word & 31) / 31.0};
  }
  const double red = at(f, offset + 2) / 255.0;
  if (packing == PixelPacking::Rgb) return {red, green, blue};
  if (packing == PixelPacking::Bgr) return {blue, green, red};
  EXPECT_EQ(red, green);
  EXPECT_EQ(green, blue);
  return {blue};
}

/// The panel's picture, row by row.
std::vector<std::vector<double>> seen(const Frame& f, const PanelLayout& layout) {
  std::vector<std::vector<double>> rows;
  for (std::uint32_t y = 0; y < layout.words.height_px; ++y) {
    rows.emplace_back();
    for (std::uint32_t x = 0; x < layout.words.width_px; ++x)
      for (const double v : pixels_of(f, y * f.pitch + x * bytes_per_word(layout.packing), layout.packing))
        rows.back().push_back(v);
  }
  return rows;
}

Mask noise(PixelSize size, std::uint32_t seed) {
  std::mt19937 rng{seed};
  Mask m{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)};
  for (auto& v : m.rows) v = static_cast<std::uint8_t>(rng());
  return m;
}

/// Mirrored, then turned a quarter clockwise as often as said, one pixel at a time.
std::vector<std::vector<double>> drawn(const Mask& mask, OpticsTurn optics, ScreenTurn turn) {
  std::vector<std::vector<double>> rows;
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y) {
    rows.emplace_back();
    for (std::uint32_t x = 0; x < mask.size.width_px; ++x)
      rows.back().push_back(mask.rows[std::size_t{y} * mask.size.width_px + x] / 255.0);
  }
  if (optics == OpticsTurn::MirrorX || optics == OpticsTurn::Rotate180)
    for (auto& row : rows) std::reverse(row.begin(), row.end());
  if (optics == OpticsTurn::MirrorY || optics == OpticsTurn::Rotate180) std::reverse(rows.begin(), rows.end());
  for (int i = 0; i < static_cast<int>(turn); ++i) {
    std::vector<std::vector<double>> turned(rows[0].size(), std::vector<double>(rows.size()));
    for (std::size_t y = 0; y < rows.size(); ++y)
      for (std::size_t x = 0; x < rows[0].size(); ++x) turned[x][rows.size() - 1 - y] = rows[y][x];
    rows = std::move(turned);
  }
  return rows;
}

TEST(Packing, LightsOnePixelOfThePanelForEachColumnOfTheMask) {
  for (const PixelPacking packing : kPackings) {
    const PanelLayout layout{{packing == PixelPacking::Grey ? 6u : 2u, 2}, packing, {}, {}};
    for (std::uint32_t column = 0; column < 6; ++column) {
      Mask mask{{6, 2}, std::vector<std::uint8_t>(12)};
      mask.rows[column] = mask.rows[6 + column] = 255;
      Frame f = frame_of(layout);
      ASSERT_TRUE(pack_mask(mask.view(), layout, f.bytes, f.pitch));
      for (const auto& row : seen(f, layout))
        for (std::uint32_t x = 0; x < 6; ++x) EXPECT_EQ(row[x], x == column ? 1 : 0) << name_of(packing) << column;
    }
  }
}

TEST(Packing, ShowsTheMaskMirroredTurnedAndCentredWhateverThePacking) {
  int looked = 0;
  for (const PixelPacking packing : kPackings)
    for (const OpticsTurn optics : kOptics)
      for (const ScreenTurn turn : kTurns)
        for (const std::uint32_t margin : {0u, 4u}) {
          const Mask mask = noise({36, 45}, 7);
          const auto want = drawn(mask, optics, turn);
          const auto w = static_cast<std::uint32_t>(want[0].size()), h = static_cast<std::uint32_t>(want.size());
          const PanelLayout layout{{w / pixels_per_word(packing) + margin, h + 2 * margin}, packing, optics, turn};
          Frame f = frame_of(layout, 12);
          ASSERT_TRUE(pack_mask(mask.view(), layout, f.bytes, f.pitch));
          const auto got = seen(f, layout);
          const std::size_t left = (got[0].size() - w) / 2, top = (got.size() - h) / 2;
          for (std::size_t y = 0; y < got.size(); ++y)
            for (std::size_t x = 0; x < got[0].size(); ++x) {
              const bool inside = y >= top && y < top + h && x >= left && x < left + w;
              const double should = inside ? want[y - top][x - left] : 0;
              // A level of its own bits lies within half a step of every grey.
              const double step = 1.0 / (greys_of(packing)[x % 3] - 1);
              ASSERT_NEAR(got[y][x], should, step / 2 + 1e-12)
                  << name_of(packing) << ' ' << name_of(optics) << ' ' << name_of(turn) << ' ' << x << ',' << y;
              ++looked;
            }
          for (std::size_t y = 0; y < got.size(); ++y)
            ASSERT_EQ(f.bytes[y * f.pitch + f.pitch - 1], std::byte{0xA5}) << "wrote behind a row";
        }
  EXPECT_GT(looked, 200'000);
}

TEST(Packing, RoundsToTheNearestLevelSoThatDarkAndFullStay) {
  for (const PixelPacking packing : {PixelPacking::Bits565, PixelPacking::Bits555}) {
    const PanelLayout layout{{256, 1}, packing, {}, {}};
    Mask mask{{768, 1}, std::vector<std::uint8_t>(768)};
    for (std::uint32_t v = 0; v < 256; ++v)
      for (std::uint32_t i = 0; i < 3; ++i) mask.rows[v * 3 + i] = static_cast<std::uint8_t>(v);
    Frame f = frame_of(layout);
    ASSERT_TRUE(pack_mask(mask.view(), layout, f.bytes, f.pitch));
    const auto row = seen(f, layout)[0];
    const auto greys = greys_of(packing);
    for (std::uint32_t x = 0; x < 768; ++x)
      EXPECT_NEAR(row[x], mask.rows[x] / 255.0, 0.5 / (greys[x % 3] - 1) + 1e-12) << x;
    EXPECT_EQ(row[0], 0);
    EXPECT_EQ(row[767], 1);
    if (packing == PixelPacking::Bits555) {
      EXPECT_EQ(at(f, 511) & 0x80u, 0u) << "the spare bit stays dark";
    }
  }
}

TEST(Packing, RefusesPixelsThatAreNotWholeWordsAndNamesTheWayOut) {
  const PanelLayout layout{{540, 2560}, PixelPacking::Bgr, {}, {}};
  const auto refused = check_fits({1619, 2560}, layout);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, HasSubstr("1619"));
  EXPECT_THAT(refused.error().what, HasSubstr("bgr"));
  EXPECT_TRUE(check_fits({1620, 2560}, layout));
  // Turned, the height is what is packed.
  EXPECT_FALSE(check_fits({2560, 1619}, {{540, 2560}, PixelPacking::Bgr, {}, ScreenTurn::Quarter}));
  EXPECT_TRUE(check_fits({2560, 1620}, {{540, 2560}, PixelPacking::Bgr, {}, ScreenTurn::Quarter}));
}

TEST(Packing, RefusesAMaskLargerThanThePanelAndAFrameSmallerThanItsWords) {
  const PanelLayout layout{{8, 4}, PixelPacking::Grey, {}, {}};
  EXPECT_THAT(check_fits({9, 4}, layout).error().what, HasSubstr("9 x 4"));
  EXPECT_FALSE(check_fits({0, 4}, layout));
  const Mask mask = noise({8, 4}, 1);
  std::vector<std::byte> bytes(8 * 4 * 4);
  EXPECT_TRUE(pack_mask(mask.view(), layout, bytes, 32));
  EXPECT_FALSE(pack_mask(mask.view(), layout, std::span{bytes}.first(127), 32));
  EXPECT_FALSE(pack_mask(mask.view(), layout, bytes, 31));
  EXPECT_FALSE(pack_mask({{8, 4}, std::span{mask.rows}.first(31)}, layout, bytes, 32));
}

}  // namespace
}  // namespace telefab::fab
