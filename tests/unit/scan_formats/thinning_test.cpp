// SPDX-License-Identifier: GPL-3.0-or-later
// Files with more points than are taken.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <random>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

/// A ball of radius 10, at random, off it by a Gaussian of `noise`.
PointCloud ball(std::size_t count, float noise, bool with_normals = true) {
  std::mt19937 rng{7};
  std::normal_distribution<float> normal;
  PointCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const Vector3f n = Vector3f{normal(rng), normal(rng), normal(rng)}.normalized();
    cloud.points.push_back((10 + noise * normal(rng)) * n);
    if (with_normals) cloud.normals.push_back(n);
  }
  return cloud;
}

Result<ScanFile> read(std::span<const std::byte> bytes, std::string_view name, std::optional<std::size_t> most) {
  return read_scan_file(bytes, name, {.most_points = most}, {});
}
Result<ScanFile> read(const PointCloud& cloud, std::optional<std::size_t> most) {
  return read(write_ply(cloud, {}, "x"), "x.ply", most);
}

bool is_thinned(const ScanFile& file) {
  return std::any_of(file.cloud.notes.begin(), file.cloud.notes.end(),
                     [](const ScanNote& note) { return note.remark == ScanRemark::Thinned; });
}

std::string text_of(const PointCloud& cloud) {
  std::string text;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vector3f &p = cloud.points[i], &n = cloud.normals[i];
    text += fmt::format("{} {} {} {} {} {}\n", p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  return text;
}

TEST(Thinning, KeepsPointsAsEvenAsTheyComeThatLeaveNoPlaceOut) {
  const PointCloud all = ball(100'000, 0);
  const auto file = read(all, 5000);
  ASSERT_TRUE(file) << file.error().what;
  ASSERT_TRUE(is_thinned(*file));
  EXPECT_LE(file->cloud.size(), 5000U);
  EXPECT_GT(file->cloud.size(), 2000U);
  const KdTree kept{file->cloud.points};
  std::array<Neighbour, 2> two;
  float nearest = 1e9F, farthest = 0;
  for (const Vector3f& p : file->cloud.points) {
    kept.nearest(p, two);
    nearest = std::min(nearest, std::sqrt(two[1].squared_distance));
  }
  for (const Vector3f& p : all.points) farthest = std::max(farthest, std::sqrt(kept.nearest(p).squared_distance));
  EXPECT_LT(farthest, 1.05F * nearest) << "no two are nearer than the reach, and none was farther from a kept one";
}

TEST(Thinning, TakesFilesOfFewerThanTwiceAsManyAsTheyAre) {
  const PointCloud all = ball(9999, 0.1F);
  const auto file = read(all, 5000), whole = read(all, std::nullopt);
  ASSERT_TRUE(file && whole);
  EXPECT_FALSE(is_thinned(*file));
  EXPECT_EQ(file->cloud.points, whole->cloud.points);
  EXPECT_EQ(file->cloud.normals, whole->cloud.normals);
}

TEST(Thinning, LowersTheNoiseAndMovesTheSurfaceNowhere) {
  const auto file = read(ball(400'000, 0.1F), 4000);
  ASSERT_TRUE(file) << file.error().what;
  double sum = 0, squares = 0;
  for (const Vector3f& p : file->cloud.points) {
    const double off = static_cast<double>(p.norm()) - 10;
    sum += off;
    squares += off * off;
  }
  const auto count = static_cast<double>(file->cloud.size());
  EXPECT_LT(std::sqrt(squares / count), 0.035) << "a hundred points each: 0.1 before";
  EXPECT_NEAR(sum / count, 0, 0.002);
  for (std::size_t i = 0; i < file->cloud.size(); ++i)
    EXPECT_GT(file->cloud.normals[i].dot(file->cloud.points[i].normalized()), 0.99F);
}

TEST(Thinning, LeavesACurvedSurfaceWhereItIs) {
  const auto file = read(ball(100'000, 0), 1000);
  ASSERT_TRUE(file) << file.error().what;
  for (const Vector3f& p : file->cloud.points) EXPECT_NEAR(p.norm(), 10, 1e-4F);
}

TEST(Thinning, KeepsBothSidesOfASheetThinnerThanWhatIsLeftOut) {
  PointCloud sheet;
  std::mt19937 rng{3};
  std::uniform_real_distribution<float> side{-10, 10};
  for (int i = 0; i < 60'000; ++i) {
    const float up = i % 2 == 0 ? 1.F : -1.F;
    sheet.points.push_back({side(rng), side(rng), 0.05F * up});
    sheet.normals.push_back({0, 0, up});
  }
  const auto file = read(sheet, 3000);
  ASSERT_TRUE(file) << file.error().what;
  std::size_t above = 0;
  for (std::size_t i = 0; i < file->cloud.size(); ++i) {
    EXPECT_NEAR(file->cloud.points[i].z(), 0.05F * file->cloud.normals[i].z(), 1e-6F);
    above += file->cloud.normals[i].z() > 0 ? 1 : 0;
  }
  EXPECT_NEAR(static_cast<double>(above) / static_cast<double>(file->cloud.size()), 0.5, 0.05);
}

TEST(Thinning, ReadsTheSamePointsOfEveryFormatAndWithoutNormals) {
  const PointCloud all = ball(30'000, 0.02F);
  const auto ply = read(all, 4000);
  const std::string text = text_of(all);
  const auto xyz = read(std::as_bytes(std::span{text}), "x.xyz", 4000);
  ASSERT_TRUE(ply && xyz);
  EXPECT_TRUE(is_thinned(*ply) && is_thinned(*xyz));
  ASSERT_EQ(ply->cloud.size(), xyz->cloud.size());
  for (std::size_t i = 0; i < ply->cloud.size(); ++i)
    EXPECT_LT((ply->cloud.points[i] - xyz->cloud.points[i]).norm(), 1e-5F);
  const auto bare = read(ball(30'000, 0, false), 4000);
  ASSERT_TRUE(bare) << bare.error().what;
  EXPECT_TRUE(is_thinned(*bare));
  EXPECT_FALSE(bare->cloud.has_normals());
  for (const Vector3f& p : bare->cloud.points) EXPECT_NEAR(p.norm(), 10, 1e-5F);
}

TEST(Thinning, GivesTheSameBytesOnAnyNumberOfThreads) {
  const PointCloud all = ball(200'000, 0.1F);
  const auto on = [&](std::size_t threads) {
    const tbb::global_control limit{tbb::global_control::max_allowed_parallelism, threads};
    return read(all, 5000);
  };
  const auto one = on(1), four = on(4);
  ASSERT_TRUE(one && four);
  EXPECT_EQ(one->cloud.points, four->cloud.points);
  EXPECT_EQ(one->cloud.normals, four->cloud.normals);
}

TEST(Thinning, LeavesOutWhatIsNotSeenAndSaysHowMany) {
  PointCloud all = ball(30'000, 0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < 30'000; i += 100) all.points[i] = Vector3f::Constant(nan);
  for (std::size_t i = 1; i < 30'000; i += 100) all.points[i].setZero();
  const auto file = read(all, 4000);
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_EQ(file->empty_returns, 600U);
  for (const Vector3f& p : file->cloud.points) EXPECT_NEAR(p.norm(), 10, 1e-4F);
  std::string notes;
  for (const ScanNote& note : file->cloud.notes) notes += note.text + "\n";
  EXPECT_THAT(notes, testing::HasSubstr("300 of 30000 points are NaN"));
  EXPECT_THAT(notes, testing::HasSubstr("300 of 30000 points are 0 0 0"));
  EXPECT_THAT(notes, testing::HasSubstr("of the 30000 points of the file"));
}

TEST(Thinning, KeepsASinglePointAtZero) {
  PointCloud all = ball(30'000, 0);
  for (Vector3f& p : all.points) p.x() += 10;
  all.points[12'000].setZero();
  const auto file = read(all, 4000);
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_EQ(file->empty_returns, 0U);
  const KdTree kept{file->cloud.points};
  EXPECT_LT(kept.nearest(Vector3f::Zero()).squared_distance, 1);
}

TEST(Thinning, RefusesAPointBeyondReachByItsNumber) {
  PointCloud all = ball(30'000, 0);
  all.points[23'456].x() = 2e12F;
  const auto file = read(all, 4000);
  ASSERT_FALSE(file);
  EXPECT_THAT(file.error().what, testing::HasSubstr("point 23456 is (1999999991808"));
}

TEST(Thinning, TakesTheCornersOfFacesThatAreKeptAsTheyAre) {
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 300\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
  for (int i = 0; i < 300; ++i) text += fmt::format("{} {} {}\n", i % 10, i / 10 % 10, i / 100);
  text += "3 0 1 299\n";
  const auto bytes = std::as_bytes(std::span{text});
  const auto kept = read_scan_file(bytes, "x.ply", {.keep_faces = true, .most_points = 50}, {});
  ASSERT_TRUE(kept) << kept.error().what;
  EXPECT_EQ(kept->cloud.size(), 300U);
  const auto bare = read(bytes, "x.ply", 50);
  ASSERT_TRUE(bare) << bare.error().what;
  EXPECT_TRUE(is_thinned(*bare));
  EXPECT_LE(bare->cloud.size(), 50U);
}

TEST(Thinning, IsNotMisledByAStrayFarAway) {
  for (const float far : {1e3F, 1e7F}) {
    PointCloud cloud = ball(100'000, 0);
    cloud.points.insert(cloud.points.begin() + 5, {far, -far, far});
    cloud.normals.insert(cloud.normals.begin() + 5, Vector3f::UnitX());
    const auto file = read(cloud, 5000);
    ASSERT_TRUE(file) << file.error().what;
    EXPECT_GT(file->cloud.size(), 2000U) << far;
    EXPECT_LE(file->cloud.size(), 5000U) << far;
  }
}

TEST(Thinning, LeavesNormalsToTheirPointsWhereTheyStandBehindAllOfThem) {
  const PointCloud cloud = ball(20'000, 0);
  std::string text = fmt::format("{}\n", cloud.size());
  for (const Vector3f& p : cloud.points) text += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
  for (const Vector3f& n : cloud.normals) text += fmt::format("{} {} {}\n", n.x(), n.y(), n.z());
  const auto file = read(std::as_bytes(std::span{text}), "x.pwn", 2000);
  ASSERT_TRUE(file) << file.error().what;
  ASSERT_EQ(file->cloud.normals.size(), file->cloud.size());
  for (std::size_t i = 0; i < file->cloud.size(); ++i) {
    const Vec3 at = file->cloud.points[i].cast<double>() + file->cloud.origin;
    ASSERT_GT(file->cloud.normals[i].cast<double>().dot(at.normalized()), 0.99) << i;
  }
}

TEST(Thinning, ComesToAnEndWhereNormalsAreNoNumbersOrFewPointsAreWanted) {
  PointCloud cloud = ball(20'000, 0);
  for (const std::size_t most : {1, 3, 2000}) {
    const auto few = read(cloud, most);
    ASSERT_TRUE(few) << few.error().what;
    EXPECT_LE(few->cloud.size(), std::max<std::size_t>(most, 8));
  }
  for (Vector3f& n : cloud.normals) n = Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());
  const std::string text = text_of(cloud);
  const auto file = read(std::as_bytes(std::span{text}), "x.xyz", 2000);
  if (file) {
    EXPECT_LE(file->cloud.size(), 2000U);
  }
}

TEST(Thinning, EndsWhereNormalsPointAnywhere) {
  std::mt19937 rng{9};
  std::normal_distribution<float> any;
  PointCloud all = ball(30'000, 0);
  for (Vector3f& n : all.normals) n = Vector3f{any(rng), any(rng), any(rng)}.normalized();
  for (std::size_t i = 0; i < all.size(); i += 3) all.normals[i].setConstant(std::numeric_limits<float>::quiet_NaN());
  for (const std::size_t most : {1U, 100U, 5000U}) {
    const auto file = read(all, most);
    ASSERT_TRUE(file) << file.error().what;
    EXPECT_LE(file->cloud.size(), std::max<std::size_t>(8, most));
  }
}

TEST(Thinning, TakesAFirstPointThatIsNoNumberForNoRounding) {
  PointCloud cloud = ball(20'000, 0);
  const std::string text = "nan nan nan 0 0 1\n" + text_of(cloud);
  const auto file = read(std::as_bytes(std::span{text}), "x.xyz", 2000);
  ASSERT_TRUE(file) << file.error().what;
  ASSERT_TRUE(is_thinned(*file));
  for (const ScanNote& note : file->cloud.notes) EXPECT_NE(note.remark, ScanRemark::CoarseCoordinates) << note.text;
}

}  // namespace
}  // namespace telefab::scan
