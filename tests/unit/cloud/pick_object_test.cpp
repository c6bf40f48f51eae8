// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <telefab/scan/cloud/pick_object.hpp>

namespace telefab::scan {
namespace {

using testing::HasSubstr;

void add_ball(PointCloud& cloud, const Vec3& middle, double radius, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(count);
    const double turn = std::numbers::pi * (3 - std::sqrt(5.)) * static_cast<double>(i), r = std::sqrt(1 - z * z);
    const Vec3 n{r * std::cos(turn), r * std::sin(turn), z};
    cloud.points.push_back((middle + radius * n).cast<float>());
  }
}

PointCloud ball(std::size_t count = 2500) {
  PointCloud cloud;
  add_ball(cloud, {0, 0, 0}, 10, count);
  return cloud;
}

double uniform(std::mt19937_64& dice) { return static_cast<double>(dice() >> 11U) * 0x1p-53; }

PickResult picked(const PointCloud& cloud, const PickOptions& options = {}) {
  auto result = pick_object(cloud, options, {});
  EXPECT_TRUE(result) << result.error().what;
  return result ? std::move(*result) : PickResult{};
}

/// Strays of every number, far and near, alone and in clumps.
class Strays : public testing::TestWithParam<std::tuple<int, double, double>> {};

TEST_P(Strays, SetNeitherSizeNorPlace) {
  const auto [count, distance, clump] = GetParam();
  for (const Vec3& way : {Vec3{0, 0, -1}, Vec3{1, 0, 0}, Vec3{-0.6, 0.64, 0.48}}) {
    PointCloud cloud = ball();
    std::mt19937_64 dice{3};
    for (int i = 0; i < count; ++i) {
      const Vec3 off{uniform(dice), uniform(dice), uniform(dice)};
      cloud.points.insert(cloud.points.begin() + static_cast<std::ptrdiff_t>(dice() % cloud.size()),
                          (distance * way + clump * off).cast<float>());
    }
    const PickResult result = picked(cloud);
    EXPECT_EQ(result.report.strays, static_cast<std::size_t>(count));
    EXPECT_EQ(result.cloud.size(), 2500U);
    EXPECT_LT((result.report.after.size() - Vec3::Constant(20)).cwiseAbs().maxCoeff(), 0.05);
    EXPECT_THAT(sentences_of(result.report).at(0), HasSubstr("belong to no surface"));
  }
}

INSTANTIATE_TEST_SUITE_P(Counts, Strays,
                         testing::Combine(testing::Values(1, 2, 5, 12, 25), testing::Values(25., 60., 400., 1e5),
                                          testing::Values(0.3, 2.)));

TEST(PickObject, LeavesACleanCloudAsItIs) {
  const PointCloud cloud = ball();
  const PickResult result = picked(cloud);
  EXPECT_EQ(result.cloud.points, cloud.points);
  EXPECT_EQ(result.report.strays, 0U);
  EXPECT_EQ(result.report.pieces.size(), 1U);
  EXPECT_FALSE(result.report.ground);
  EXPECT_TRUE(sentences_of(result.report).empty());
}

TEST(PickObject, KeepsStraysWhenAsked) {
  PointCloud cloud = ball();
  cloud.points.emplace_back(0, 0, -400);
  EXPECT_EQ(picked(cloud, {.keep_outliers = true}).cloud.size(), 2501U);
}

TEST(PickObject, DropsPointsScatteredInSpace) {
  for (const double share : {0.01, 0.05}) {
    PointCloud cloud = ball(10'000);
    std::mt19937_64 dice{9};
    std::size_t far = 0;
    for (int i = 0; i < static_cast<int>(10'000 * share); ++i) {
      const Vec3 p = 60 * Vec3{uniform(dice) - 0.5, uniform(dice) - 0.5, uniform(dice) - 0.5};
      cloud.points.push_back(p.cast<float>());
      far += std::abs(p.norm() - 10) > 5 ? 1 : 0;
    }
    const PickResult result = picked(cloud);
    EXPECT_GE(result.report.strays, far * 99 / 100) << share;
    EXPECT_LT((result.report.after.size() - Vec3::Constant(20)).cwiseAbs().maxCoeff(), 8) << share;
  }
}

TEST(PickObject, KeepsEveryPieceAndChoosesTheLargestWhenAsked) {
  PointCloud cloud = ball();
  add_ball(cloud, {40, 0, 0}, 3, 300);
  add_ball(cloud, {-30, 0, 8}, 1, 60);
  const PickResult all = picked(cloud);
  EXPECT_EQ(all.cloud.size(), cloud.size());
  ASSERT_EQ(all.report.pieces.size(), 3U);
  EXPECT_EQ(all.report.pieces[1].points, 300U);
  EXPECT_THAT(sentences_of(all.report).at(0), HasSubstr("a piece of 60 points"));
  EXPECT_EQ(picked(cloud, {.pieces = 1}).cloud.size(), 2500U);
  const PickResult second = picked(cloud, {.only = {2}});
  EXPECT_EQ(second.cloud.size(), 300U) << "the second largest alone";
  EXPECT_TRUE(second.report.pieces[1].kept);
  EXPECT_FALSE(second.report.pieces[0].kept);
  EXPECT_EQ(picked(cloud, {.only = {1, 2}}).cloud.size(), 2800U);
  const auto none = pick_object(cloud, {.only = {1, 9}}, {});
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().what, testing::HasSubstr("no piece 9"));
  EXPECT_EQ(picked(cloud, {.pieces = 2}).cloud.size(), 2800U);
  const PickResult one = picked(cloud, {.pieces = 1});
  EXPECT_EQ(one.report.in_other_pieces, 360U);
  EXPECT_FALSE(one.report.pieces[1].kept);
}

TEST(PickObject, TakesTheLinesOfALineScannerForOnePiece) {
  for (const double apart : {5., 10., 25.}) {
    PointCloud cloud;  // a tube: points dense along rings, rings far apart
    const double step = 0.1, ring = step * apart;
    for (int k = 0; k < 60; ++k)
      for (int i = 0; i < 628; ++i)
        cloud.points.emplace_back(10 * std::cos(i * step / 10), 10 * std::sin(i * step / 10), k * ring);
    const PickResult result = picked(cloud);
    EXPECT_EQ(result.cloud.size(), cloud.size()) << apart;
    EXPECT_EQ(result.report.pieces.size(), 1U) << apart;
  }
}

TEST(PickObject, CropsInTheFrameOfTheFile) {
  PointCloud cloud = ball();
  cloud.origin = {1000, -500, 20};
  const auto box = crop_box_from("1000,-510,10,1010,-490,30");
  ASSERT_TRUE(box);
  const PickResult half = picked(cloud, {.crop = *box});
  EXPECT_NEAR(static_cast<double>(half.cloud.size()), 1250, 15);
  EXPECT_EQ(half.report.cropped, 2500 - half.cloud.size());
  const auto none = pick_object(cloud, {.crop = Box3{{0, 0, 0}, {1, 1, 1}}}, {});
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().what, HasSubstr("the scan reaches from (990"));
}

TEST(PickObject, NamesTheGroundAndLeavesItOutWithAPieceChosen) {
  PointCloud cloud = ball();
  for (Eigen::Vector3f& p : cloud.points) p.z() += 10;
  std::erase_if(cloud.points, [](const auto& p) { return p.z() < 0.5F; });
  const std::size_t object = cloud.size();
  for (int i = -50; i <= 50; ++i)
    for (int k = -50; k <= 50; ++k)
      if (i * i + k * k > 16)
        cloud.points.emplace_back(0.6F * static_cast<float>(i), 0.6F * static_cast<float>(k), 0.F);
  const PickResult all = picked(cloud);
  ASSERT_TRUE(all.report.ground);
  EXPECT_GT(all.report.ground->up.z(), 0.99);
  EXPECT_EQ(all.cloud.size(), cloud.size());
  EXPECT_THAT(sentences_of(all.report).at(0), HasSubstr("the object stands on it"));
  const PickResult alone = picked(cloud, {.pieces = 1});
  EXPECT_GT(alone.cloud.size(), object * 9 / 10);
  EXPECT_LE(alone.cloud.size(), object);
}

TEST(PickObject, TakesNoFlatFaceForGround) {
  PointCloud block;
  for (int i = 0; i <= 32; ++i)
    for (int k = 0; k <= 32; ++k)
      for (const float z : {0.F, 8.F}) {
        const float u = 0.25F * static_cast<float>(i), v = 0.25F * static_cast<float>(k);
        block.points.emplace_back(u, v, z);
        block.points.emplace_back(u, z, v);
        block.points.emplace_back(z, u, v);
      }
  EXPECT_FALSE(picked(block).report.ground);
}

TEST(PickObject, SaysThatAScatteringOfPiecesIsAScene) {
  PointCloud cloud;
  for (int i = 0; i < 12; ++i) add_ball(cloud, {30. * i, 0, 0}, 5, 400);
  const PickResult result = picked(cloud);
  EXPECT_TRUE(result.report.is_scene);
  const std::string advice = sentences_of(result.report).at(0);
  EXPECT_THAT(advice, HasSubstr("looks like a scene"));
  EXPECT_THAT(advice, HasSubstr("--pieces largest keeps that one"));
  // A box to begin with, as --crop takes it.
  const auto from = advice.find("of all there is in ") + 19;
  const auto box = crop_box_from(advice.substr(from, advice.find(' ', from) - from));
  ASSERT_TRUE(box) << advice;
  EXPECT_LT((box->max - result.report.before.max).cwiseAbs().maxCoeff(), 0.1);
  // What was done is not advised again.
  const PickResult largest = picked(cloud, {.pieces = 1});
  const auto advised = sentences_of(largest.report);
  EXPECT_TRUE(std::none_of(advised.begin(), advised.end(),
                           [](const std::string& s) { return s.find("--pieces largest") != std::string::npos; }));
  EXPECT_TRUE(std::any_of(advised.begin(), advised.end(),
                          [](const std::string& s) { return s.find("--crop") != std::string::npos; }));
}

TEST(PickObject, AnswersDegenerateCloudsWithOneClearError) {
  const auto why = [](const std::vector<Eigen::Vector3f>& points) {
    PointCloud cloud;
    cloud.points = points;
    const auto result = pick_object(cloud, {}, {});
    return result ? std::string{"no error"} : result.error().what;
  };
  std::vector<Eigen::Vector3f> line, rows, plane, tilted;
  for (int i = 0; i < 100; ++i) {
    const auto f = static_cast<float>(i);
    line.emplace_back(f, 2 * f, -f);
    rows.emplace_back(f, static_cast<float>(i % 2), 3.F);
    plane.emplace_back(static_cast<float>(i % 10), static_cast<float>(i / 10), 0.F);
    tilted.emplace_back(static_cast<float>(i % 10), static_cast<float>(i / 10), 0.5F * static_cast<float>(i % 10));
  }
  for (const std::size_t count : {0U, 1U, 2U, 3U, 12U, 29U})
    EXPECT_THAT(why({line.begin(), line.begin() + static_cast<std::ptrdiff_t>(count)}), HasSubstr("too few"));
  EXPECT_THAT(why(line), HasSubstr("on one line"));
  for (const auto& flat : {rows, plane, tilted}) EXPECT_THAT(why(flat), HasSubstr("in one plane"));
  EXPECT_THAT(why(std::vector<Eigen::Vector3f>(500, {1, 2, 3})), HasSubstr("in one place"));
}

TEST(CropBox, IsReadFromTextOrRefused) {
  const auto box = crop_box_from("10,-2.5,3, -1,2,1e1");
  ASSERT_TRUE(box) << box.error().what;
  EXPECT_EQ(box->min, Vec3(-1, -2.5, 3));
  EXPECT_EQ(box->max, Vec3(10, 2, 10));
  for (const char* text : {"", "1,2,3", "1,2,3,4,5,6,7", "a,2,3,4,5,6", "1;2;3;4;5;6", "1,2,3,4,5,nan", "1,2,3,4,5,"})
    EXPECT_FALSE(crop_box_from(text)) << text;
  EXPECT_EQ(piece_numbers_from("only:3,1,3").value(), (std::vector<std::uint32_t>{1, 3}));
  for (const char* text :
       {"", "only:", "only:0", "only:1,", "only:,1", "only:1;2", "only:-1", "1,2", "only:99999999999"})
    EXPECT_FALSE(piece_numbers_from(text)) << text;
  EXPECT_EQ(pieces_from("largest").value(), 1U);
  EXPECT_EQ(pieces_from("all").value(), 0U);
  EXPECT_EQ(pieces_from("3").value(), 3U);
  for (const char* text : {"", "0", "-1", "most", "2.5"}) EXPECT_FALSE(pieces_from(text)) << text;
}

}  // namespace
}  // namespace telefab::scan
