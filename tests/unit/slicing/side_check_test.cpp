// SPDX-License-Identifier: GPL-3.0-or-later
#include "side_check.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace telefab::scan {
namespace {

/// Ring about the middle of the build frame; clockwise where the radius is negative.
Contour circle(double x, double y, double radius) {
  std::vector<Point2> vertices;
  constexpr int kCount = 96;
  for (int i = 0; i < kCount; ++i) {
    const double a = (radius > 0 ? 1 : -1) * 2 * std::numbers::pi * i / kCount;
    vertices.push_back({x + std::abs(radius) * std::cos(a), y + std::abs(radius) * std::sin(a)});
  }
  return *Contour::from_vertices(std::move(vertices));
}

/// A ball of radius 10 mm about the origin with a round void of radius 4 mm in it.
class SideCheck : public testing::Test {
 protected:
  void SetUp() override {
    PointCloud cloud;
    for (const auto& [radius, count] : {std::pair{10.0F, 6000}, std::pair{-4.0F, 1000}})
      for (int i = 0; i < count; ++i) {
        const float z = 1 - (2 * static_cast<float>(i) + 1) / static_cast<float>(count);
        const float a = 2.39996323F * static_cast<float>(i), r = std::sqrt(1 - z * z);
        const Eigen::Vector3f out{r * std::cos(a), r * std::sin(a), z};
        cloud.points.push_back(std::abs(radius) * out);
        cloud.normals.push_back(radius > 0 ? out : Eigen::Vector3f{-out});
      }
    auto field = MlsField::from_cloud(std::move(cloud), {}, {});
    ASSERT_TRUE(field) << field.error().what;
    field_ = std::move(*field);
    auto scan = CompletedScan::of(*field_, {}, {}, {});
    ASSERT_TRUE(scan) << scan.error().what;
    scan_ = std::move(*scan);
    field_->samples_between(-0.5, 0.5, near_);
  }
  [[nodiscard]] std::optional<Point2> asked(std::span<const Contour> contours) const {
    return contradicted_side(*scan_, *field_, contours, 0, near_);
  }

  std::unique_ptr<MlsField> field_;
  std::unique_ptr<CompletedScan> scan_;
  SurfaceSamples near_;
};

TEST_F(SideCheck, BearsOutTheRightContours) { EXPECT_FALSE(asked(std::vector{circle(0, 0, 10), circle(0, 0, -4)})); }

TEST_F(SideCheck, ContradictsAMissingHoleInsideOfIt) {
  const auto place = asked(std::vector{circle(0, 0, 10)});
  ASSERT_TRUE(place);
  EXPECT_LT(std::hypot(place->x_mm, place->y_mm), 4);
}

TEST_F(SideCheck, ContradictsARingTooMany) {
  const auto place = asked(std::vector{circle(0, 0, 10), circle(0, 0, -4), circle(14, 0, 3)});
  ASSERT_TRUE(place);
  EXPECT_LT(std::hypot(place->x_mm - 14, place->y_mm), 3);
}

TEST_F(SideCheck, ContradictsAnEmptyLayerAmongSamples) { EXPECT_TRUE(asked({})); }

TEST_F(SideCheck, FindsStretchesNearerThanAKernelAndNoOthers) {
  const double width = field_->kernel_width_mm({10, 0, 0});
  EXPECT_FALSE(narrow_passage(*field_, std::vector{circle(0, 0, 10), circle(0, 0, -4)}, 0));
  EXPECT_FALSE(narrow_passage(*field_, std::vector{circle(0, 0, 10), circle(20 + 1.2 * width, 0, 10)}, 0));
  const auto between = narrow_passage(*field_, std::vector{circle(0, 0, 10), circle(20 + 0.5 * width, 0, 10)}, 0);
  ASSERT_TRUE(between);
  EXPECT_NEAR(between->x_mm, 10, 1);
  EXPECT_NEAR(between->y_mm, 0, 2.5);
}

TEST_F(SideCheck, FindsANeckOfOneRing) {
  const double half = 0.3 * field_->kernel_width_mm({10, 0, 0});
  const auto dumbbell = Contour::from_vertices({{-8, -3},
                                                {-3, -3},
                                                {-2, -half},
                                                {2, -half},
                                                {3, -3},
                                                {8, -3},
                                                {8, 3},
                                                {3, 3},
                                                {2, half},
                                                {-2, half},
                                                {-3, 3},
                                                {-8, 3}});
  ASSERT_TRUE(dumbbell);
  const auto neck = narrow_passage(*field_, std::span{&*dumbbell, 1}, 0);
  ASSERT_TRUE(neck);
  EXPECT_LT(std::abs(neck->x_mm), 3);
}

}  // namespace
}  // namespace telefab::scan
