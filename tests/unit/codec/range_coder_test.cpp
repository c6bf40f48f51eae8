// SPDX-License-Identifier: GPL-3.0-or-later
#include "range_coder.hpp"

#include <gtest/gtest.h>

#include <random>

namespace telefab::codec {
namespace {

class RangeCoderProperty : public testing::TestWithParam<std::uint64_t> {};

TEST_P(RangeCoderProperty, GivesBackEveryBitAndNumberAndUsesAllBytes) {
  std::mt19937_64 rng{GetParam()};
  struct Item {
    int kind;
    std::uint32_t value;
    unsigned context;
  };
  std::vector<Item> items;
  for (int i = 0; i < 5000; ++i) {
    const auto width = static_cast<unsigned>(rng() % 33);
    const auto value = static_cast<std::uint32_t>(width == 0 ? 0 : rng() >> (64 - width));
    items.push_back({static_cast<int>(rng() % 3), value, static_cast<unsigned>(rng() % 4)});
  }
  RangeEncoder encoder;
  BitModel bit;
  NumberModel<4> number;
  for (const Item& item : items) {
    if (item.kind == 0) encoder.encode(bit, item.value % 7 == 0 ? 1 : 0);
    if (item.kind == 1) encoder.encode_direct(item.value, 32);
    if (item.kind == 2) number.encode(encoder, item.value, item.context);
  }
  const auto bytes = encoder.finish();
  RangeDecoder decoder{bytes};
  BitModel bit_again;
  NumberModel<4> number_again;
  for (const Item& item : items) {
    if (item.kind == 0) {
      ASSERT_EQ(decoder.decode(bit_again), item.value % 7 == 0 ? 1U : 0U);
    }
    if (item.kind == 1) {
      ASSERT_EQ(decoder.decode_direct(32), item.value);
    }
    if (item.kind == 2) {
      ASSERT_EQ(number_again.decode(decoder, item.context), item.value);
    }
  }
  EXPECT_TRUE(decoder.at_end());
}
INSTANTIATE_TEST_SUITE_P(Seeds, RangeCoderProperty, testing::Range<std::uint64_t>(0, 32));

TEST(RangeCoder, SpendsLittleOnWhatItHasLearnt) {
  RangeEncoder encoder;
  BitModel model;
  for (int i = 0; i < 8000; ++i) encoder.encode(model, 0);
  EXPECT_LT(encoder.finish().size(), 40U);  // 0.0014 bit each at the floor
}

TEST(RangeDecoder, RemembersThatItReadPastTheEnd) {
  RangeDecoder decoder{{}};
  EXPECT_TRUE(decoder.overrun());
  EXPECT_EQ(decoder.decode_direct(32), 0U);
}

TEST(ZigZag, GivesBackTheSmallestAndTheLargestNumber) {
  for (const std::int32_t value :
       {0, -1, 1, std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()})
    EXPECT_EQ(unzigzag(zigzag(value)), value);
}

}  // namespace
}  // namespace telefab::codec
