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
INSTANTIATE_TEST_SUITE_P(Seeds, PngProperty, testing::Range<std::uint64_t>(0, 20));

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
  auto damaged = bytes;
  damaged[bytes.size() / 2] ^= std::byte{0x10};
  EXPECT_FALSE(decode_png(damaged, 10'000));
  EXPECT_FALSE(decode_png(std::as_bytes(std::span{"no image"}), 10'000));
}

TEST(DecodePng, RefusesMorePixelsThanAllowedBeforeItReadsThem) {
  const auto bytes = encode_png({100, 100, 1, std::vector<std::uint8_t>(10'000)}).value();
  EXPECT_EQ(decode_png(bytes, 9'999).error().code, ErrorCode::TooLarge);
}

}  // namespace
}  // namespace telefab
