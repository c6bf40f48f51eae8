// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <telefab/scan/digitize/models.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/staging/joined_views.hpp>

#include "../registration/lump.hpp"

namespace telefab::scan {
namespace {

using testing::HasSubstr;

/// What a view holds of the lump: points between two heights, in another pose.
ViewFile part_of_lump(const std::string& name, std::uint64_t seed, float low, float high, const RigidMotion& motion) {
  const PointCloud all = reference_cloud(lump_mesh(), 0.8, seed);
  std::string text;
  for (const auto& p : all.points) {
    if (p.z() < low || p.z() > high) continue;
    const Vec3 q = motion * p.cast<double>();
    text += std::to_string(q.x()) + ' ' + std::to_string(q.y()) + ' ' + std::to_string(q.z()) + '\n';
  }
  const auto bytes = std::as_bytes(std::span{text});
  return {name, {bytes.begin(), bytes.end()}};
}

RigidMotion tipped() {
  return Eigen::Translation3d{5, -80, 30} * Eigen::AngleAxisd{1.9, Vec3{1, 0.3, -0.2}.normalized()};
}

TEST(JoinedViews, MakesTwoHalvesInTwoPosesTheWholeBodyAgain) {
  const auto joined = joined_views({part_of_lump("lower.xyz", 1, -100, 14, RigidMotion::Identity()),
                                    part_of_lump("upper.xyz", 2, -14, 100, tipped())},
                                   {}, {});
  ASSERT_TRUE(joined.has_value()) << joined.error().what;
  EXPECT_EQ(nlohmann::json::parse(joined->facts_json)["views"], 2);
  const auto cloud = read_cloud(joined->ply, "joined.ply", {}, {});
  ASSERT_TRUE(cloud.has_value());
  const PointCloud all = reference_cloud(lump_mesh(), 0.8, 1);
  Box3 found = Box3::nothing(), wanted = Box3::nothing();
  for (const auto& p : cloud->points) found.include(Vec3{cloud->origin + p.cast<double>()});
  for (const auto& p : all.points) wanted.include(Vec3{p.cast<double>()});
  EXPECT_LT((found.min - wanted.min).cwiseAbs().maxCoeff(), 0.6);
  EXPECT_LT((found.max - wanted.max).cwiseAbs().maxCoeff(), 0.6);
}

TEST(JoinedViews, NamesTheFileThatIsNoView) {
  const std::string none = "not a scan";
  const auto bytes = std::as_bytes(std::span{none});
  const auto joined = joined_views(
      {part_of_lump("lower.xyz", 1, -100, 14, RigidMotion::Identity()), {"none.ply", {bytes.begin(), bytes.end()}}}, {},
      {});
  ASSERT_FALSE(joined.has_value());
  EXPECT_THAT(joined.error().what, HasSubstr("none.ply"));
}

TEST(JoinedViews, WantsTwo) {
  EXPECT_EQ(joined_views({part_of_lump("a.xyz", 1, -100, 100, RigidMotion::Identity())}, {}, {}).error().code,
            ErrorCode::InvalidInput);
}

}  // namespace
}  // namespace telefab::scan
