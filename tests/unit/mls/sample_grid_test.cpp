// SPDX-License-Identifier: GPL-3.0-or-later
#include "sample_grid.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <set>
#include <vector>

namespace telefab::scan {
namespace {

struct Scattered {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> widths;
};

Scattered scattered(std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random{seed};
  const auto uniform = [&] { return static_cast<float>(random() % 100000) * 1e-5F; };
  Scattered s;
  for (std::size_t i = 0; i < count; ++i) {
    s.points.emplace_back(30 * uniform(), 10 * uniform(), 5 * uniform());
    s.normals.push_back(Eigen::Vector3f{uniform(), uniform(), uniform()}.normalized());
    s.widths.push_back(0.5F + uniform());
  }
  return s;
}

std::vector<float> flat(const Eigen::Vector3f& v) { return {v.x(), v.y(), v.z()}; }

TEST(SampleGrid, FindsEverySampleWithinTheRadius) {
  const Scattered s = scattered(5000, 1);
  const SampleGrid grid{s.points, s.normals, s.widths, 0.9};
  ASSERT_EQ(grid.size(), s.points.size());
  const std::vector<Eigen::Vector3f> centres{{15, 5, 2}, {0, 0, 0}, {30, 10, 5}, {-1, 4, 6}, {12.6F, 9, 1}};
  for (const Eigen::Vector3f& centre : centres) {
    constexpr float kRadius = 1.7F;
    std::multiset<std::vector<float>> expected, found;
    for (const auto& p : s.points)
      if ((p - centre).norm() < kRadius) expected.insert(flat(p));
    grid.visit(centre, kRadius, [&](std::uint32_t first, std::uint32_t last) {
      for (std::uint32_t i = first; i < last; ++i)
        if ((grid.place(i) - centre).norm() < kRadius) found.insert(flat(grid.place(i)));
    });
    EXPECT_EQ(found, expected);
  }
}

TEST(SampleGrid, KeepsSampleNormalAndWidthTogether) {
  const Scattered s = scattered(1000, 2);
  SampleGrid grid{s.points, s.normals, s.widths, 1.1};
  std::vector<std::uint8_t> flags(grid.size());
  for (std::uint32_t i = 0; i < grid.size(); ++i) flags[i] = grid.place(i).x() < 20 ? 1 : 0;
  grid.keep(flags);
  std::set<std::vector<float>> expected, found;
  for (std::size_t i = 0; i < s.points.size(); ++i)
    if (s.points[i].x() < 20) expected.insert({s.points[i].x(), s.points[i].y(), s.normals[i].z(), s.widths[i]});
  grid.visit({15, 5, 2}, 100, [&](std::uint32_t first, std::uint32_t last) {
    for (std::uint32_t i = first; i < last; ++i)
      found.insert({grid.place(i).x(), grid.place(i).y(), grid.normal(i).z(), grid.width(i)});
  });
  EXPECT_EQ(found, expected);
  EXPECT_EQ(grid.widest_mm(), std::max_element(found.begin(), found.end(), [](const auto& a, const auto& b) {
                                return a[3] < b[3];
                              })->back());
}

TEST(SampleGrid, HoldsAFarOutlierWithoutCountingTheCellsBetween) {
  Scattered s = scattered(1000, 3);
  s.points.emplace_back(1e7F, -1e7F, 1e7F);
  s.normals.emplace_back(0, 0, 1);
  const SampleGrid grid{s.points, s.normals, {}, 0.5};
  std::size_t found = 0;
  grid.visit({1e7F, -1e7F, 1e7F}, 10, [&](std::uint32_t first, std::uint32_t last) { found += last - first; });
  EXPECT_EQ(found, 1U);
}

TEST(SampleGrid, SortsTheSameWhateverTheOrderOfThePoints) {
  const Scattered s = scattered(2000, 4);
  Scattered turned = s;
  std::reverse(turned.points.begin(), turned.points.end());
  std::reverse(turned.normals.begin(), turned.normals.end());
  const SampleGrid a{s.points, s.normals, {}, 1};
  const SampleGrid b{turned.points, turned.normals, {}, 1};
  for (std::uint32_t i = 0; i < a.size(); ++i) EXPECT_EQ(a.place(i), b.place(i));
}

TEST(Gather, CopiesTheSameBytesOnEveryInstructionSet) {
#ifdef TELEFAB_KERNEL_AVX2
  if (!__builtin_cpu_supports("avx2")) GTEST_SKIP() << "no AVX2 here";
  const Scattered s = scattered(3000, 5);
  for (const bool one_width : {false, true}) {
    const SampleGrid grid{s.points, s.normals, one_width ? std::span<const float>{} : s.widths, 0.8};
    std::vector<SampleRun> runs;
    grid.visit({11, 6, 2}, 3, [&](std::uint32_t first, std::uint32_t last) { runs.push_back({first, last}); });
    GatherInput in = grid.arrays();
    in.x = 11, in.y = 6, in.z = 2, in.margin = 0.2F, in.scale = 1.7F;
    constexpr std::size_t kStride = 3072;
    std::vector<float> one(7 * kStride), other(7 * kStride);
    const std::size_t count = baseline_kernels().gather(in, runs.data(), runs.size(), {one.data(), kStride}, 3);
    ASSERT_GT(count, 20U);
    ASSERT_EQ(avx2_kernels().gather(in, runs.data(), runs.size(), {other.data(), kStride}, 3), count);
    for (std::size_t a = 0; a < 7; ++a)
      for (std::size_t i = 3; i < count; ++i) EXPECT_EQ(one[a * kStride + i], other[a * kStride + i]);
  }
#else
  GTEST_SKIP() << "one instruction set on this machine";
#endif
}

TEST(Surroundings, AreTheSameBytesOnEveryInstructionSet) {
#ifdef TELEFAB_KERNEL_AVX2
  if (!__builtin_cpu_supports("avx2")) GTEST_SKIP() << "no AVX2 here";
  const Scattered s = scattered(3000, 6);
  const SampleGrid grid{s.points, s.normals, s.widths, 0.8};
  std::vector<SampleRun> runs;
  grid.visit({11, 6, 2}, 3, [&](std::uint32_t first, std::uint32_t last) { runs.push_back({first, last}); });
  const GatherInput arrays = grid.arrays();
  const NearInput in{arrays.places, arrays.normals, 11, 6, 2, 0.6F, -0.5F, 0.3F, 4};
  std::vector<float> one(3008), other(3008);
  const std::size_t count = baseline_kernels().distances(in, runs.data(), runs.size(), one.data());
  ASSERT_GT(count, 20U);
  ASSERT_LT(count, 900U);
  ASSERT_EQ(avx2_kernels().distances(in, runs.data(), runs.size(), other.data()), count);
  one.resize(count);
  other.resize(count);
  EXPECT_EQ(one, other);
  const float mean = baseline_kernels().mean(in, runs.data(), runs.size(), arrays.widths, -1);
  EXPECT_EQ(mean, avx2_kernels().mean(in, runs.data(), runs.size(), arrays.widths, -1));
  EXPECT_NEAR(mean, 1, 0.1);
#else
  GTEST_SKIP() << "one instruction set on this machine";
#endif
}

}  // namespace
}  // namespace telefab::scan
