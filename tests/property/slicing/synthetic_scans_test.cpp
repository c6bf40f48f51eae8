// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <map>

#include "synthetic_scan.hpp"

namespace telefab::campaign {
namespace {

/// Of every kind this many cases, spread over them; the campaign looks at all.
constexpr std::size_t kOfAKind = 2;

std::vector<SyntheticScan> some_of_every_kind() {
  std::map<std::string, std::vector<SyntheticScan>> kinds;
  for (SyntheticScan& scan : synthetic_scans()) kinds[scan.kind].push_back(std::move(scan));
  std::vector<SyntheticScan> some;
  for (auto& [kind, scans] : kinds)
    for (std::size_t i = 0; i < kOfAKind; ++i) some.push_back(std::move(scans[(2 * i + 1) * scans.size() / 5]));
  return some;
}

TEST(SyntheticScans, CertifyNoWrongLayerAndNearlyAllRightOnes) {
  SyntheticVerdict sum;
  for (const SyntheticScan& scan : some_of_every_kind()) {
    const auto verdict = judge(scan);
    ASSERT_TRUE(verdict) << scan.kind << ", " << scan.name << ": " << verdict.error().what;
    EXPECT_EQ(verdict->wrong_certified, 0)
        << scan.kind << ", " << scan.name << (verdict->lines.empty() ? "" : ": " + verdict->lines.front());
    sum += *verdict;
  }
  EXPECT_GT(sum.right_certified + sum.right_flagged, 500);
  EXPECT_GE(sum.right_certified, 0.9 * (sum.right_certified + sum.right_flagged));
}

TEST(SyntheticScans, AreMoreThanTwoHundredAndTheSameAtEveryCall) {
  const auto scans = synthetic_scans();
  EXPECT_GE(scans.size(), 200U);
  EXPECT_EQ(scans.front().samples().points, scans.front().samples().points);
}

}  // namespace
}  // namespace telefab::campaign
