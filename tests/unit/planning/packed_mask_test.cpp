// SPDX-License-Identifier: GPL-3.0-or-later
#include "packed_mask.hpp"

#include <gtest/gtest.h>

#include <random>

namespace telefab::fab {
namespace {

Mask mask_of(PixelSize size, auto grey) {
  Mask mask{size, {}};
  for (std::uint32_t i = 0; i < size.width_px * size.height_px; ++i)
    mask.rows.push_back(static_cast<std::uint8_t>(grey(i)));
  return mask;
}

TEST(PackedMask, GivesEveryMaskBack) {
  std::mt19937 random{7};
  const PixelSize size{613, 401};
  const Mask masks[]{mask_of(size, [](std::uint32_t) { return 0; }),
                     mask_of(size, [](std::uint32_t) { return 255; }),
                     mask_of(size, [](std::uint32_t i) { return i % 2 == 0 ? 0 : 255; }),
                     mask_of(size, [](std::uint32_t i) { return i / 100 % 256; }),
                     mask_of(size, [&](std::uint32_t) { return random() % 256; }),
                     mask_of({1, 1}, [](std::uint32_t) { return 3; }),
                     mask_of({0, 0}, [](std::uint32_t) { return 0; })};
  for (const Mask& mask : masks) EXPECT_TRUE(PackedMask{mask}.unpacked() == mask);
  // Longer than one run can say.
  const Mask large = mask_of({5000, 4000}, [](std::uint32_t) { return 255; });
  EXPECT_TRUE(PackedMask{large}.unpacked() == large);
}

TEST(PackedMask, IsSmallWhereAMaskIsAndNeverMuchLargerThanIt) {
  const PixelSize size{1857, 1142};
  const std::size_t pixels = std::size_t{size.width_px} * size.height_px;
  const Mask part =
      mask_of(size, [&](std::uint32_t i) { return i % size.width_px > 500 && i % size.width_px < 900 ? 255 : 0; });
  EXPECT_LT(PackedMask{part}.bytes(), pixels / 100);
  std::mt19937 random{7};
  const Mask noise = mask_of(size, [&](std::uint32_t) { return random() % 256; });
  EXPECT_EQ(PackedMask{noise}.bytes(), pixels);
}

}  // namespace
}  // namespace telefab::fab
