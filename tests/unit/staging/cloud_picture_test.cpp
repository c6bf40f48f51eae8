// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <numeric>
#include <random>
#include <telefab/scan/staging/cloud_picture.hpp>

namespace telefab::scan {
namespace {

std::vector<Eigen::Vector3f> cube(std::size_t count, std::uint32_t seed) {
  std::mt19937 random{seed};
  std::uniform_real_distribution<float> at{0, 10};
  std::vector<Eigen::Vector3f> points;
  for (std::size_t i = 0; i < count; ++i) points.emplace_back(at(random), at(random), at(random));
  return points;
}

template <class Value>
Value at(const std::vector<std::byte>& bytes, std::size_t offset) {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

TEST(ProgressiveOrder, HoldsEveryPointOnce) {
  for (const std::size_t count : {0U, 1U, 2U, 3U, 1000U, 4097U}) {
    auto order = progressive_order(cube(count, 1), 1'000'000);
    std::sort(order.begin(), order.end());
    std::vector<std::uint32_t> all(count);
    std::iota(all.begin(), all.end(), 0U);
    EXPECT_EQ(order, all);
  }
}

TEST(ProgressiveOrder, SpreadsEachBeginningEvenly) {
  const auto points = cube(64'000, 2);
  const auto order = progressive_order(points, points.size());
  // Octants of a beginning hold an eighth of it each, far nearer than chance has it.
  for (const std::size_t beginning : {1024U, 8192U}) {
    std::array<std::size_t, 8> in{};
    for (std::size_t i = 0; i < beginning; ++i) {
      const Eigen::Vector3f& p = points[order[i]];
      ++in[(p.x() > 5 ? 1U : 0U) + (p.y() > 5 ? 2U : 0U) + (p.z() > 5 ? 4U : 0U)];
    }
    for (const std::size_t count : in)
      EXPECT_NEAR(static_cast<double>(count), static_cast<double>(beginning) / 8,
                  0.03 * static_cast<double>(beginning) / 8 + 4);
  }
}

TEST(ProgressiveOrder, GivesAtMostWhatIsAskedForOfPointsInOnePlace) {
  const std::vector<Eigen::Vector3f> same(5000, Eigen::Vector3f{1, 2, 3});
  EXPECT_EQ(progressive_order(same, 100).size(), 100U);
}

TEST(CloudPicture, GivesEveryPointInItsLevelsToHalfAQuantum) {
  ShownPoints shown;
  shown.origin = {1e6, -2e6, 3};
  shown.points = cube(120'000, 3);
  const CloudPicture picture{shown};
  ASSERT_EQ(picture.levels(), 2U);
  std::size_t points = 0;
  double worst = 0;
  const auto order = progressive_order(shown.points, shown.points.size());
  for (std::uint32_t level = 0; level < picture.levels(); ++level) {
    const auto bytes = picture.level(level);
    EXPECT_EQ(at<std::uint32_t>(bytes, 0), CloudPicture::kMagic);
    EXPECT_EQ(at<std::uint32_t>(bytes, 8), level);
    EXPECT_EQ(at<std::uint32_t>(bytes, 16), points);
    const auto count = at<std::uint32_t>(bytes, 20);
    EXPECT_EQ(at<std::uint32_t>(bytes, 24), 120'000U);
    EXPECT_EQ(bytes.size(), CloudPicture::kHeadBytes + 8 * count);
    const double step = at<double>(bytes, 56);
    for (std::size_t i = 0; i < count; ++i)
      for (int k = 0; k < 3; ++k) {
        const double seen = at<double>(bytes, 32 + 8 * static_cast<std::size_t>(k)) +
                            step * at<std::uint16_t>(bytes, 64 + 8 * i + 2 * static_cast<std::size_t>(k));
        const double is = shown.origin[k] + static_cast<double>(shown.points[order[points + i]][k]);
        worst = std::max(worst, std::abs(seen - is) / step);
      }
    points += count;
  }
  EXPECT_EQ(points, 120'000U);
  EXPECT_LE(worst, 0.51);
}

TEST(CloudPicture, CarriesKindsAndNormals) {
  ShownPoints shown;
  shown.points = {{0, 0, 0}, {1, 0, 0}};
  shown.normals = {{0, 0, 1}, {-1, 0, 0}};
  shown.kinds = {PointKind::Doubtful, PointKind::Completed};
  const auto bytes = CloudPicture{shown}.level(0);
  ASSERT_EQ(bytes.size(), 64U + 2 * 12);
  const bool is_first = at<std::uint16_t>(bytes, 64) == 0;
  const std::size_t a = is_first ? 0 : 1, b = 1 - a;
  EXPECT_EQ(at<std::uint16_t>(bytes, 64 + 8 * a + 6), 3);
  EXPECT_EQ(at<std::uint16_t>(bytes, 64 + 8 * b + 6), 2);
  EXPECT_EQ(at<std::int8_t>(bytes, 80 + 4 * a + 2), 127);
  EXPECT_EQ(at<std::int8_t>(bytes, 80 + 4 * b), -127);
}

TEST(CloudPicture, ShowsNothingOfNothing) { EXPECT_EQ(CloudPicture{ShownPoints{}}.levels(), 0U); }

TEST(CloudPicture, IsTheSameEachTime) {
  ShownPoints shown;
  shown.points = cube(70'000, 4);
  EXPECT_EQ(CloudPicture{shown}.level(1), CloudPicture{shown}.level(1));
}

}  // namespace
}  // namespace telefab::scan
