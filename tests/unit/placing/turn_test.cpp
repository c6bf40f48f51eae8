// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>
#include <random>
#include <telefab/scan/placing/turn.hpp>

namespace telefab::scan {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using testing::HasSubstr;

constexpr double kDegree = std::numbers::pi / 180;

TEST(Turn, AxesTurnFirstAboutXThenYThenZ) {
  using Axis = Eigen::AngleAxisd;
  const Turn turn = Turn::about_axes({10, 20, 30}).value();
  const Matrix3d wanted = (Axis{30 * kDegree, Vector3d::UnitZ()} * Axis{20 * kDegree, Vector3d::UnitY()} *
                           Axis{10 * kDegree, Vector3d::UnitX()})
                              .toRotationMatrix();
  EXPECT_TRUE(turn.matrix().isApprox(wanted, 1e-15));
  // Counter-clockwise where the axis points at you: x goes to y.
  EXPECT_EQ(Turn::about_axes({0, 0, 90})->matrix() * Vector3d::UnitX(), Vector3d::UnitY());
}

TEST(Turn, QuarterTurnsAreExact) {
  for (const double x : {-180., -90., 0., 90., 180., 270.})
    for (const double y : {-90., 0., 90.})
      for (const double z : {-90., 0., 90., 180., 360.}) {
        const Matrix3d m = Turn::about_axes({x, y, z})->matrix();
        EXPECT_TRUE(((m.array() == 0) || (m.array().abs() == 1)).all()) << x << ' ' << y << ' ' << z;
      }
}

TEST(Turn, PutsTheNamedDirectionUpTheShortestWay) {
  std::mt19937_64 random{5};
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Vector3d up = 7 * Vector3d{normal(random), normal(random), normal(random)};
    const Matrix3d m = Turn::with_up(up)->matrix();
    EXPECT_TRUE((m * up.normalized()).isApprox(Vector3d::UnitZ(), 1e-12));
    EXPECT_NEAR(m.determinant(), 1, 1e-12);
    const double angle = std::acos(std::clamp((m.trace() - 1) / 2, -1.0, 1.0));
    EXPECT_NEAR(angle, std::acos(up.normalized().z()), 1e-6);
  }
  EXPECT_EQ(Turn::with_up({0, 0, -2})->matrix() * Vector3d::UnitZ(), -Vector3d::UnitZ());
  EXPECT_TRUE((Turn::with_up({1e-9, 0, -1})->matrix() * Vector3d{1e-9, 0, -1}).isApprox(Vector3d::UnitZ(), 1e-12));
  EXPECT_TRUE(Turn::with_up({0, 0, 3})->is_none());
  EXPECT_EQ(Turn::with_up(Vector3d::Zero()).error().code, ErrorCode::InvalidInput);
}

TEST(Turn, AnglesSayTheSameTurnAgain) {
  std::mt19937_64 random{6};
  std::uniform_real_distribution<double> any{-180, 180};
  for (int i = 0; i < 300; ++i) {
    // Every third looks along its own axis, where x and z do the same.
    const double y = i % 3 == 0 ? (i % 2 == 0 ? 90 : -90) : any(random);
    const Turn turn = Turn::about_axes({any(random), y, any(random)}).value();
    EXPECT_TRUE(Turn::about_axes(turn.angles_deg())->matrix().isApprox(turn.matrix(), 1e-9)) << i;
    EXPECT_TRUE(turn_from_rotate(rotate_text(turn))->matrix().isApprox(turn.matrix(), 3e-8)) << rotate_text(turn);
  }
  EXPECT_EQ(rotate_text(Turn::about_axes({-90, 0, 180}).value()), "-90,0,180");
  EXPECT_EQ(rotate_text(Turn{}), "0,0,0");
}

TEST(Turn, MatrixIsReadRowByRowAndRoundingIsRemoved) {
  EXPECT_EQ(turn_from_rotate("0,-1,0, 1,0,0, 0,0,1").value(), Turn::about_axes({0, 0, 90}).value());
  const auto rounded = turn_from_rotate("0.7071,-0.7071,0,0.7071,0.7071,0,0,0,1");
  ASSERT_TRUE(rounded) << rounded.error().what;
  EXPECT_TRUE((rounded->matrix() * rounded->matrix().transpose()).isApprox(Matrix3d::Identity(), 1e-15));
  EXPECT_TRUE(rounded->matrix().isApprox(Turn::about_axes({0, 0, 45})->matrix(), 1e-9));
}

TEST(Turn, WhatIsNoRotationIsRefusedWithTheReason) {
  const auto why = [](std::string_view text) {
    const auto turn = turn_from_rotate(text);
    return turn ? std::string{"taken"} : turn.error().what;
  };
  EXPECT_THAT(why("2,0,0,0,2,0,0,0,2"), HasSubstr("lengths 2, 2 and 2"));
  EXPECT_THAT(why("1,0,0,0,1,0,0,0,-1"), HasSubstr("mirror"));
  EXPECT_THAT(why("1,0,0,0.6,0.8,0,0,0,1"), HasSubstr("right angles"));
  EXPECT_THAT(why("1,2"), HasSubstr("three angles"));
  EXPECT_THAT(why("1,2,x"), HasSubstr("numbers with commas"));
  EXPECT_THAT(why("1,2,"), HasSubstr("numbers with commas"));
  EXPECT_THAT(why("1,2,nan"), HasSubstr("numbers with commas"));
  EXPECT_THAT(why("0,0,1e9"), HasSubstr("3600"));
  EXPECT_THAT(turn_from_up("w").error().what, HasSubstr("x, -x, y, -y, z, -z"));
  EXPECT_THAT(turn_from_up("0,0,0").error().what, HasSubstr("no length"));
}

TEST(Turn, UpNamesAnAxisOrADirection) {
  EXPECT_EQ(turn_from_up("-y")->matrix() * -Vector3d::UnitY(), Vector3d::UnitZ());
  EXPECT_TRUE((turn_from_up("1, 0, 1")->matrix() * Vector3d{1, 0, 1}.normalized()).isApprox(Vector3d::UnitZ()));
  EXPECT_EQ(turn_from_up("1,0,0").value(), turn_from_up("x").value());
}

}  // namespace
}  // namespace telefab::scan
