// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/join_scans.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <numbers>
#include <telefab/scan/digitize/models.hpp>

#include "lump.hpp"

namespace telefab::scan {
namespace {

using testing::HasSubstr;

constexpr double kNoiseMm = 0.03;
constexpr DigitizeOptions kTurn{.step_deg = 60, .pitch_mm = 1, .tilt_deg = 0, .noise_mm = kNoiseMm};
const JoinScansOptions kJoin{.join = {.max_rms = 0.6}, .axis_direction = Vec3::UnitY()};

RigidMotion turned_over() {
  RigidMotion motion = RigidMotion::Identity();
  motion.linear() = Eigen::AngleAxisd{130 * std::numbers::pi / 180, Vec3{0.8, 0.6, 0}}.toRotationMatrix();
  return motion;
}

DigitizeModel mirrored(DigitizeModel model) {
  for (Vec3& p : model.points) p.y() = -p.y();
  for (auto& t : model.triangles) std::swap(t[1], t[2]);
  return model;
}

/// Scans of one object in several placements, as one list, and where every view stands in the object.
struct Scans {
  std::vector<RangeImage> views;
  std::vector<RigidMotion> to_model;
  std::vector<ScanGroup> groups;

  void add(const std::string& name, Scene scene, const RigidMotion& placed, double step_deg) {
    groups.push_back({name, views.size(), scene.images.size(), step_deg});
    for (std::size_t i = 0; i < scene.images.size(); ++i) {
      scene.images[i].name = name + "/" + scene.images[i].name;
      views.push_back(std::move(scene.images[i]));
      to_model.push_back(placed.inverse() * scene.to_model[i]);
    }
  }
  /// Every group as a series whose turn is known exactly: what is tried is the join.
  [[nodiscard]] std::vector<ViewSeries> series() const {
    std::vector<ViewSeries> all;
    for (const ScanGroup& g : groups) {
      all.push_back({g.name, {}, {}});
      for (std::size_t v = g.first; v < g.first + g.count; ++v) {
        all.back().views.push_back(v);
        all.back().poses.push_back(to_model[g.first].inverse() * to_model[v]);
      }
    }
    return all;
  }
  void expect_poses(const JoinedScans& found, double degrees, double shift_mm) const {
    const Joined& joined = found.joined;
    const RigidMotion first = to_model[joined.kept[0]].inverse();
    for (std::size_t i = 0; i < joined.kept.size(); ++i) {
      const RigidMotion truth = first * to_model[joined.kept[i]];
      const MotionDifference d =
          difference(joined.registration.poses[i], truth, to_model[joined.kept[i]].inverse() * Vec3{0, 0, 0});
      EXPECT_LT(d.degrees, degrees) << "view " << joined.kept[i];
      EXPECT_LT(d.shift, shift_mm) << "view " << joined.kept[i];
    }
  }
};

Scans two_series(const DigitizeModel& first, const DigitizeModel& second, DigitizeOptions options = kTurn) {
  Scans scans;
  scans.add("upright", scene_of(first, options), RigidMotion::Identity(), options.step_deg);
  options.seed = 2;
  scans.add("over", scene_of(moved(second, turned_over()), options), turned_over(), options.step_deg);
  return scans;
}

/// Views of one turn of eight, in no order.
Scans views_in_any_order(std::size_t count = 8) {
  Scene turn = scene_of(knobbly_mesh(), {.step_deg = 45, .pitch_mm = 1, .tilt_deg = 10, .noise_mm = kNoiseMm});
  Scene mixed;
  for (const std::size_t i : {5U, 7U, 6U, 4U, 2U, 3U, 0U, 1U}) {
    if (mixed.images.size() == count) break;
    mixed.images.push_back(turn.images[i]);
    mixed.to_model.push_back(turn.to_model[i]);
  }
  Scans scans;
  scans.add("mixed", std::move(mixed), RigidMotion::Identity(), 0);
  return scans;
}

TEST(JoinScans, JoinsTwoSeriesOfAnObjectTurnedOver) {
  Scans scans = two_series(knobbly_mesh(), knobbly_mesh());
  const auto found = join_scans(scans.views, scans.groups, kJoin, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  ASSERT_EQ(found->joined.kept.size(), 12U);
  scans.expect_poses(*found, 0.1, 0.05);
  for (const SeriesReport& r : found->joined.series) {
    EXPECT_TRUE(r.is_joined());
    EXPECT_GT(r.overlap, 0.5);
    EXPECT_LT(r.rms, 1.3 * r.noise);
    EXPECT_LT(*r.conflict, 0.005);
  }
  ASSERT_TRUE(found->up);
  EXPECT_GT(std::abs(found->up->y()), 0.99) << "the first turn's axis is upright in its scanner";
}

// The noise is nearly nothing then, and what is left is how two views sample a curve.
TEST(JoinScans, JoinsSeriesWithoutAnyNoiseAndRefusesTheMirroredOne) {
  DigitizeOptions clean = kTurn;
  clean.noise_mm = 0;
  clean.pitch_mm = 0.8;
  Scans scans = two_series(knobbly_mesh(), knobbly_mesh(), clean);
  const auto found = join_scans(scans.views, scans.groups, kJoin, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  scans.expect_poses(*found, 0.1, 0.05);
  Scans mirrored = two_series(near_symmetric_mesh(1), near_symmetric_mesh(-1), clean);
  EXPECT_FALSE(join_scans(mirrored.views, mirrored.groups, kJoin, {}, {}));
}

TEST(JoinScans, JoinsViewsInAnyOrderAndPose) {
  Scans scans = views_in_any_order();
  const auto found = join_scans(scans.views, scans.groups, kJoin, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  ASSERT_EQ(found->joined.kept.size(), 8U);
  scans.expect_poses(*found, 0.2, 0.1);
  EXPECT_FALSE(found->up) << "nothing was turned";
}

TEST(JoinScans, GivesTheSameBytesOnOneThreadAndOnMore) {
  const auto bytes = [](std::size_t threads) {
    const tbb::global_control limit{tbb::global_control::max_allowed_parallelism, threads};
    Scans scans = views_in_any_order(4);
    const auto found = join_scans(scans.views, scans.groups, kJoin, {}, {});
    EXPECT_TRUE(found) << found.error().what;
    std::vector<double> numbers;
    if (!found) return std::make_pair(numbers, std::string{});
    for (const RigidMotion& pose : found->joined.registration.poses)
      numbers.insert(numbers.end(), pose.data(), pose.data() + 16);
    return std::make_pair(numbers, to_json(found->joined.series));
  };
  const auto one = bytes(1);
  EXPECT_FALSE(one.first.empty());
  EXPECT_EQ(one, bytes(4));
}

TEST(JoinScans, NamesTheWaysASymmetricBodyFitsAndTakesOneWhereAsked) {
  const auto knot = shape_model("knot", 50);
  ASSERT_TRUE(knot);
  Scans scans = two_series(*knot, *knot);
  const std::vector<RangeImage> views = scans.views;
  const auto refused = join_views(scans.views, scans.series(), kJoin.join, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotConverged);
  EXPECT_THAT(refused.error().what,
              HasSubstr("over fits in 6 ways that the scan cannot tell apart: turns of 120 and 180 degrees"));
  JoinOptions options = kJoin.join;
  options.accept_symmetry = true;
  scans.views = views;
  const auto taken = join_views(scans.views, scans.series(), options, {}, {});
  ASSERT_TRUE(taken) << taken.error().what;
  EXPECT_TRUE(taken->series[1].is_joined());
  EXPECT_EQ(taken->series[1].equal_turns_deg.size(), 5U);
}

TEST(JoinScans, RefusesABodyThatTurnsOnItself) {
  const auto torus = shape_model("torus", 50);
  ASSERT_TRUE(torus);
  Scans scans = two_series(*torus, *torus);
  const auto refused = join_views(scans.views, scans.series(), kJoin.join, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("may slide or turn"));
}

TEST(JoinScans, RefusesASeriesOfTheMirroredObject) {
  Scans scans = two_series(knobbly_mesh(), mirrored(knobbly_mesh()));
  const auto refused = join_views(scans.views, scans.series(), kJoin.join, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotConverged);
  EXPECT_THAT(refused.error().what, HasSubstr("over"));
}

TEST(JoinScans, RefusesAMirroredSeriesThatDiffersByLessThanTheNoise) {
  DigitizeOptions options = kTurn;
  options.noise_mm = 0.25;
  const DigitizeModel body = near_symmetric_mesh(0.2);
  JoinOptions join = kJoin.join;
  join.max_rms = 1;
  Scans same = two_series(body, near_symmetric_mesh(0.2), options);
  const auto found = join_views(same.views, same.series(), join, {}, {});
  EXPECT_TRUE(found) << found.error().what;
  Scans scans = two_series(body, mirrored(body), options);
  const auto refused = join_views(scans.views, scans.series(), join, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("over fits to"));
}

TEST(JoinScans, LeavesOutByNameAMirroredViewAndOneOfAnotherObject) {
  Scans scans = views_in_any_order();
  const DigitizeOptions one{.step_deg = 360, .views = 1, .pitch_mm = 1, .tilt_deg = 10, .noise_mm = kNoiseMm};
  scans.add("mirror", scene_of(mirrored(knobbly_mesh()), one), RigidMotion::Identity(), 0);
  scans.add("knot", scene_of(*shape_model("knot", 50), one), RigidMotion::Identity(), 0);
  const auto found = join_scans(scans.views, scans.groups, kJoin, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  SCOPED_TRACE(to_json(found->joined.series));
  EXPECT_EQ(found->joined.kept, (std::vector<std::size_t>{0, 1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(scans.views.size(), 8U);
  scans.expect_poses(*found, 0.2, 0.1);
  EXPECT_THAT(found->notes, testing::Contains(testing::AllOf(HasSubstr("mirror/view_0"), HasSubstr("left out"))));
  EXPECT_THAT(found->notes, testing::Contains(testing::AllOf(HasSubstr("knot/view_0"), HasSubstr("left out"))));
}

TEST(JoinScans, NamesAScanThatIsGivenTwice) {
  Scans scans = views_in_any_order();
  RangeImage copy = scans.views[2];
  copy.name = "copy";
  scans.views.push_back(std::move(copy));
  scans.groups.push_back({"copy", 8, 1, 0});
  const auto found = join_scans(scans.views, scans.groups, kJoin, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  EXPECT_EQ(found->joined.kept.size(), 8U);
  EXPECT_THAT(found->notes, testing::Contains(HasSubstr("copy is the same scan as " + scans.views[2].name)));
  Scans again = two_series(knobbly_mesh(), knobbly_mesh());
  for (std::size_t i = 0; i < 6; ++i) again.views[6 + i].points = again.views[i].points;
  const auto refused = join_views(again.views, again.series(), kJoin.join, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("over is the same scan as upright"));
}

TEST(JoinScans, RefusesSeriesThatHardlyShowTheSame) {
  Scans scans = two_series(knobbly_mesh(), knobbly_mesh());
  // each keeps its own half and a strip of the other's
  for (std::size_t v = 0; v < scans.views.size(); ++v) {
    std::vector<bool> keep;
    for (const auto& p : scans.views[v].points) {
      const double x = (scans.to_model[v] * p.cast<double>()).x();
      keep.push_back(v < 6 ? x < 2 : x > -2);
    }
    keep_points(scans.views[v], keep);
  }
  const auto refused = join_views(scans.views, scans.series(), kJoin.join, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotConverged);
  EXPECT_THAT(refused.error().what, HasSubstr("scan"));
}

TEST(JoinScans, TakesTheTableOutOfEveryTurnBeforeTurnsAreJoined) {
  const auto on_table = [](DigitizeModel body) {
    double low = 1e9;
    for (const Vec3& p : body.points) low = std::min(low, p.z());
    const auto corner = static_cast<std::uint32_t>(body.points.size());
    // an octagon, so that its outline is another one in every view
    for (int k = 0; k < 8; ++k)
      body.points.emplace_back(70 * std::cos(k * std::numbers::pi / 4 + 0.2),
                               70 * std::sin(k * std::numbers::pi / 4 + 0.2), low);
    for (std::uint32_t k = 1; k < 7; ++k) body.triangles.push_back({corner, corner + k, corner + k + 1});
    return body;
  };
  const DigitizeOptions options{.step_deg = 60, .pitch_mm = 1, .tilt_deg = 25, .noise_mm = kNoiseMm};
  Scans scans;
  scans.add("upright", scene_of(on_table(knobbly_mesh()), options), RigidMotion::Identity(), 60);
  scans.add("over", scene_of(on_table(moved(knobbly_mesh(), turned_over())), options), turned_over(), 60);
  JoinScansOptions join = kJoin;
  join.axis_direction = std::nullopt;  // that of the table
  const auto found = join_scans(scans.views, scans.groups, join, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  scans.expect_poses(*found, 0.1, 0.05);
  EXPECT_GT(found->table_points, 10'000U);
  EXPECT_THAT(found->notes, testing::Contains(HasSubstr("table")));
  double widest = 0;
  for (std::size_t v = 0; v < scans.views.size(); ++v)
    for (const auto& p : scans.views[v].points)
      widest = std::max(widest, (scans.to_model[v] * p.cast<double>()).norm());
  EXPECT_LT(widest, 45) << "the table reaches out to 70 mm";
}

TEST(JoinScans, JoinsCloudsWithoutGridsAndSaysThatFreeSpaceWasNotTested) {
  const PointCloud all = reference_cloud(lump_mesh(), 0.8, 1), again = reference_cloud(lump_mesh(), 0.8, 2);
  const auto part = [](const PointCloud& cloud, auto keep, const RigidMotion& motion, const std::string& name) {
    PointCloud some;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (!keep(cloud.points[i])) continue;
      some.points.push_back((motion * cloud.points[i].cast<double>()).cast<float>());
      some.normals.push_back((motion.rotation() * cloud.normals[i].cast<double>()).cast<float>());
    }
    auto image = make_gridless_image(some, name);
    EXPECT_TRUE(image) << image.error().what;
    return std::move(*image);
  };
  std::vector<RangeImage> views;
  views.push_back(part(
      all, [](const auto& p) { return p.z() < 14; }, RigidMotion::Identity(), "lower"));
  views.push_back(part(
      again, [](const auto& p) { return p.z() > -14; }, turned_over(), "upper"));
  const auto found = join_scans(views, {{"lower", 0, 1, 0}, {"upper", 1, 1, 0}}, kJoin, {}, {});
  ASSERT_TRUE(found) << found.error().what;
  EXPECT_LT(difference(found->joined.registration.poses[1], turned_over().inverse(), Vec3::Zero()).degrees, 0.1);
  EXPECT_FALSE(found->joined.series[1].conflict);
  EXPECT_THAT(found->notes, testing::Contains(HasSubstr("free space not tested")));
  EXPECT_THAT(found->notes, testing::Contains(HasSubstr("noise of the scan is guessed")));
}

TEST(JoinScans, RefusesOptionsThatMakeNoSense) {
  EXPECT_FALSE((JoinOptions{.max_rms = 0}.validate()));
  EXPECT_FALSE((JoinOptions{.max_rms = 1, .min_overlap = 0}.validate()));
  EXPECT_FALSE((JoinOptions{.max_rms = 1, .max_rms_ratio = 1}.validate()));
  EXPECT_FALSE((JoinOptions{.max_rms = 1, .max_conflict = -1}.validate()));
  EXPECT_FALSE((JoinOptions{.max_rms = 1, .min_stiffness = 1}.validate()));
  EXPECT_TRUE((JoinOptions{.max_rms = 1}.validate()));
  Scans scans = views_in_any_order();
  JoinScansOptions options = kJoin;
  options.cut_below = 3;
  const auto refused = join_scans(scans.views, scans.groups, options, {}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("no turn was given"));
}

}  // namespace
}  // namespace telefab::scan
