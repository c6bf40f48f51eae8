// SPDX-License-Identifier: GPL-3.0-or-later
#include "ring_check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace telefab::codec {
namespace {

using Ring = std::vector<GridPoint>;
using testing::HasSubstr;

Ring box(std::int32_t low, std::int32_t high) { return {{low, low}, {high, low}, {high, high}, {low, high}}; }
Ring hole(std::int32_t low, std::int32_t high) { return {{low, low}, {low, high}, {high, high}, {high, low}}; }

std::string fault(const std::vector<Ring>& rings) {
  const auto checked = check_rings(rings);
  return checked ? "" : checked.error().what;
}

TEST(RingCheck, AcceptsAnIslandInAHoleInAnOuterRing) {
  EXPECT_EQ(fault({box(0, 90), hole(10, 80), box(20, 70), box(100, 120)}), "");
}

TEST(RingCheck, RefusesRingsThatCrossTouchOrFold) {
  EXPECT_THAT(fault({box(0, 50), {{40, 10}, {80, 10}, {80, 20}, {40, 20}}}), HasSubstr("cross"));
  EXPECT_THAT(fault({box(0, 50), {{50, 10}, {80, 10}, {80, 20}}}), HasSubstr("touch"));
  EXPECT_THAT(fault({{{0, 0}, {40, 40}, {40, 0}, {0, 40}, {-10, 20}}}), HasSubstr("cross"));
  EXPECT_THAT(fault({{{0, 0}, {40, 0}, {20, 0}, {20, 30}}}), HasSubstr("touch"));
}

TEST(RingCheck, RefusesAHoleOutsideAndAnOuterRingInsideAnother) {
  EXPECT_THAT(fault({box(0, 50), hole(60, 70)}), HasSubstr("hole lies outside"));
  EXPECT_THAT(fault({box(0, 50), box(10, 20)}), HasSubstr("where a hole belongs"));
}

}  // namespace
}  // namespace telefab::codec
