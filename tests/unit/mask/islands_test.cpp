#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <queue>
#include <random>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {
namespace {

Mask drawn(std::vector<std::string_view> rows) {
  Mask mask{{static_cast<std::uint32_t>(rows[0].size()), static_cast<std::uint32_t>(rows.size())}, {}};
  for (const std::string_view row : rows)
    for (const char c : row) mask.rows.push_back(c == '#' ? 255 : c == '+' ? 100 : 0);
  return mask;
}

std::vector<Island> islands(const Mask& above, const Mask& below, std::uint64_t least = 1) {
  return unsupported_islands(cured_runs(above, 128), cured_runs(below, 128), least);
}

TEST(UnsupportedIslands, FindsThePatchWithNothingBelow) {
  const auto found = islands(drawn({"##..#.", "##..##", "......"}), drawn({".#....", "......", "######"}));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].area_px, 3U);
  EXPECT_NEAR(found[0].x_px, 4.833, 0.001);
}

TEST(UnsupportedIslands, JoinsPatchesAcrossCorners) {
  EXPECT_TRUE(islands(drawn({"#...", ".#..", "..#."}), drawn({"#...", "....", "...."})).empty());
  EXPECT_TRUE(islands(drawn({"..#.", ".#..", "#..."}), drawn({"....", "....", "#..."})).empty());
}

TEST(UnsupportedIslands, PassesOverSmallOnesAndGreyBelowTheThreshold) {
  EXPECT_TRUE(islands(drawn({"##.."}), drawn({"...."}), 3).empty());
  EXPECT_TRUE(islands(drawn({"++++"}), drawn({"...."})).empty());
}

class IslandsProperty : public testing::TestWithParam<std::uint64_t> {};
TEST_P(IslandsProperty, AgreesWithAFloodFillPixelByPixel) {
  std::mt19937_64 rng{GetParam()};
  const auto noise = [&](std::uint64_t one_in) {
    Mask mask{{40, 30}, std::vector<std::uint8_t>(1200)};
    for (auto& p : mask.rows) p = rng() % one_in == 0 ? 255 : 0;
    return mask;
  };
  const Mask above = noise(3);
  const Mask below = noise(40);
  std::vector<bool> seen(1200, false);
  std::vector<std::uint64_t> expected;
  for (int start = 0; start < 1200; ++start) {
    if (seen[start] || !above.rows[start]) continue;
    std::uint64_t area = 0;
    bool held = false;
    std::queue<int> queue;
    queue.push(start);
    seen[start] = true;
    while (!queue.empty()) {
      const int p = queue.front();
      queue.pop();
      ++area;
      held = held || below.rows[p];
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int x = p % 40 + dx;
          const int y = p / 40 + dy;
          if (x < 0 || y < 0 || x >= 40 || y >= 30 || seen[y * 40 + x] || !above.rows[y * 40 + x]) continue;
          seen[y * 40 + x] = true;
          queue.push(y * 40 + x);
        }
    }
    if (!held) expected.push_back(area);
  }
  std::vector<std::uint64_t> found;
  for (const Island& island : islands(above, below)) found.push_back(island.area_px);
  EXPECT_EQ(found, expected);
  EXPECT_FALSE(expected.empty());
}
INSTANTIATE_TEST_SUITE_P(Seeds, IslandsProperty, testing::Range<std::uint64_t>(0, 20));

}  // namespace
}  // namespace telefab::fab
