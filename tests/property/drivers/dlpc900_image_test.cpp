// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <telefab/fab/drivers/dlpc900_image.hpp>

namespace telefab::fab {
namespace {

Mask random_mask(std::mt19937_64& rng, int kind) {
  std::uniform_int_distribution<std::uint32_t> side{1, 300};
  Mask m{{side(rng), side(rng)}, {}};
  const std::uint32_t w = m.size.width_px, h = m.size.height_px;
  m.rows.resize(std::size_t{w} * h);
  switch (kind) {
    case 0:  // noise
      for (auto& p : m.rows) p = static_cast<std::uint8_t>(rng());
      break;
    case 1:  // bands across
      for (std::size_t i = 0; i < m.rows.size(); ++i) m.rows[i] = static_cast<std::uint8_t>(i / w / 5 % 3 * 100);
      break;
    case 2:  // bands along, one odd pixel
      for (std::size_t i = 0; i < m.rows.size(); ++i) m.rows[i] = i % w / 3 % 2 == 0 ? 255 : 0;
      m.rows[rng() % m.rows.size()] ^= 77;
      break;
    case 3: {  // a disc with grey edges
      const double r = std::min(w, h) * 0.4;
      for (std::uint32_t y = 0; y < h; ++y)
        for (std::uint32_t x = 0; x < w; ++x) {
          const double d = r - std::hypot(x - w * 0.5, y - h * 0.5);
          m.rows[std::size_t{y} * w + x] = static_cast<std::uint8_t>(std::clamp(d + 0.5, 0.0, 1.0) * 255);
        }
      break;
    }
    default:  // runs of random length, rows often repeated
      for (std::size_t i = 0; i < m.rows.size();) {
        const std::size_t n = std::min<std::size_t>(m.rows.size() - i, 1 + rng() % 40);
        if (i >= w && rng() % 2 == 0)
          for (std::size_t k = 0; k < n; ++k) m.rows[i + k] = m.rows[i + k - w];
        else
          std::fill_n(m.rows.begin() + static_cast<std::ptrdiff_t>(i), n, static_cast<std::uint8_t>(rng() % 4 * 60));
        i += n;
      }
  }
  return m;
}

class ImageProperty : public testing::TestWithParam<std::uint64_t> {};

TEST_P(ImageProperty, DecodesToTheMaskItWasMadeOfAndStaysSmall) {
  std::mt19937_64 rng{GetParam()};
  for (int kind = 0; kind < 5; ++kind) {
    const Mask mask = random_mask(rng, kind);
    const auto image = encode_dlpc900_image(mask.view());
    const auto back = decode_dlpc900_image(image);
    ASSERT_TRUE(back) << back.error().what << ", kind " << kind;
    ASSERT_EQ(*back, mask) << "kind " << kind;
    EXPECT_LE(image.size(), kSplashHeaderBytes + mask.rows.size() * 4 + mask.size.height_px * 2 + 8);
  }
}

TEST_P(ImageProperty, RefusesADamagedImageOrGivesAMaskOfItsSize) {
  std::mt19937_64 rng{GetParam()};
  auto image = encode_dlpc900_image(random_mask(rng, 4).view());
  for (int i = 0; i < 200; ++i) {
    auto damaged = image;
    damaged[rng() % damaged.size()] ^= std::byte(1u << rng() % 8);
    if (rng() % 4 == 0) damaged.resize(rng() % damaged.size());
    if (const auto mask = decode_dlpc900_image(damaged)) {
      EXPECT_EQ(mask->rows.size(), std::size_t{mask->size.width_px} * mask->size.height_px);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, ImageProperty, testing::Range<std::uint64_t>(0, 48));

TEST(ImageProperty, CountsAWholeRowLongerThanTheLongestRun) {
  const Mask mask{{4096, 12}, std::vector<std::uint8_t>(std::size_t{4096} * 12, 3)};
  const auto back = decode_dlpc900_image(encode_dlpc900_image(mask.view()));
  ASSERT_TRUE(back);
  EXPECT_EQ(*back, mask);
}

}  // namespace
}  // namespace telefab::fab
