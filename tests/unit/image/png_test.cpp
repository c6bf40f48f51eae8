// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <random>
#include <telefab/image/png.hpp>

namespace telefab {
namespace {

Image random_image(std::uint64_t seed, std::uint32_t channels) {
  std::mt19937_64 rng{seed};
  Image image{static_cast<std::uint32_t>(1 + rng() % 70), static_cast<std::uint32_t>(1 + rng() % 70), channels, {}};
  image.pixels.resize(std::size_t{image.width_px} * image.height_px * channels);
  for (auto& p : image.pixels) p = rng() % 3 ? 0 : static_cast<std::uint8_t>(rng());
  return image;
}

class PngProperty : public testing::TestWithParam<std::uint64_t> {};
TEST_P(PngProperty, ComesBackPixelByPixelThroughAnotherReader) {
  for (const std::uint32_t channels : {1U, 3U}) {
    const Image image = random_image(GetParam(), channels);
    const auto bytes = encode_png(image);
    ASSERT_TRUE(bytes);
    EXPECT_EQ(decode_png(*bytes, 10'000).value(), image);
  }
}
/// Runs of any length, rows that repeat or nearly do, blank stretches: what masks are made of, at any width.
Image mask_like(std::uint64_t seed) {
  std::mt19937_64 rng{seed};
  constexpr std::uint32_t widths[] = {1, 2, 3, 257, 258, 259, 260, 261, 516, 1857, 32766, 32767, 32768, 40000};
  Image image{widths[seed % std::size(widths)], static_cast<std::uint32_t>(1 + rng() % 40), 1, {}};
  std::vector<std::uint8_t> row(image.width_px);
  for (std::uint32_t y = 0; y < image.height_px; ++y) {
    const auto kind = rng() % 5;
    if (kind == 0) std::fill(row.begin(), row.end(), static_cast<std::uint8_t>(rng() % 2 ? 0 : 255));
    if (kind == 1)
      for (std::size_t x = 0; x < row.size();) {
        const std::size_t end = std::min(row.size(), x + 1 + rng() % (1U << (rng() % 12)));
        std::fill(row.begin() + static_cast<std::ptrdiff_t>(x), row.begin() + static_cast<std::ptrdiff_t>(end),
                  static_cast<std::uint8_t>(rng() % 3 ? 255 * (rng() % 2) : rng()));
        x = end;
      }
    if (kind == 2) row[rng() % row.size()] = static_cast<std::uint8_t>(rng());
    image.pixels.insert(image.pixels.end(), row.begin(), row.end());
  }
  return image;
}

TEST_P(PngProperty, GivesMasksBackThroughAnotherReaderAndTheSameBytesTwice) {
  for (std::uint64_t k = 0; k < 14; ++k) {
    const Image image = mask_like(GetParam() * 14 + k);
    const auto bytes = encode_png(image);
    ASSERT_TRUE(bytes);
    ASSERT_EQ(decode_png(*bytes, 10'000'000).value(), image) << image.width_px << " x " << image.height_px;
    EXPECT_EQ(encode_png(image).value(), *bytes);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, PngProperty, testing::Range<std::uint64_t>(0, 20));

TEST(EncodePng, TakesNextToNothingForABlankMask) {
  const auto bytes = encode_png_grey(3840, 2160, std::vector<std::uint8_t>(3840 * 2160)).value();
  EXPECT_LT(bytes.size(), 10'000U);
}

TEST(EncodePng, TakesNoMoreThanThePixelsForNoise) {
  std::mt19937_64 rng{3};
  Image noise{500, 400, 1, std::vector<std::uint8_t>(200'000)};
  for (auto& p : noise.pixels) p = static_cast<std::uint8_t>(rng());
  const auto bytes = encode_png(noise).value();
  EXPECT_LT(bytes.size(), 201'000U);
  EXPECT_EQ(decode_png(bytes, 200'000).value(), noise);
}

TEST(EncodePng, RefusesSizesThatDoNotFitThePixels) {
  EXPECT_FALSE(encode_png({2, 2, 1, {0, 0, 0}}));
  EXPECT_FALSE(encode_png({0, 0, 1, {}}));
  EXPECT_FALSE(encode_png({1, 1, 2, {0, 0}}));
  EXPECT_FALSE(encode_png({0xFFFF'FFFF, 0xFFFF'FFFF, 3, {}}));
}

TEST(DecodePng, RefusesTruncationDamageAndNoise) {
  const auto bytes = encode_png(random_image(3, 1)).value();
  for (std::size_t size = 0; size + 12 < bytes.size(); size += 7)
    EXPECT_FALSE(decode_png(std::span{bytes}.first(size), 10'000)) << size;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    auto damaged = bytes;
    damaged[at] ^= std::byte{0x10};
    EXPECT_FALSE(decode_png(damaged, 10'000)) << at;
  }
  EXPECT_FALSE(decode_png(std::as_bytes(std::span{"no image"}), 10'000));
}

TEST(DecodePng, RefusesMorePixelsThanAllowedBeforeItReadsThem) {
  const auto bytes = encode_png({100, 100, 1, std::vector<std::uint8_t>(10'000)}).value();
  EXPECT_EQ(decode_png(bytes, 9'999).error().code, ErrorCode::TooLarge);
}

}  // namespace
}  // namespace telefab
