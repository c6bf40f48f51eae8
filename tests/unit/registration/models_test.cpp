// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <numbers>
#include <telefab/scan/digitize/models.hpp>

namespace telefab::scan {
namespace {

double signed_volume(const DigitizeModel& model) {
  double sum = 0;
  for (const auto& t : model.triangles) sum += model.points[t[0]].dot(model.points[t[1]].cross(model.points[t[2]])) / 6;
  return sum;
}

double height(const DigitizeModel& model) {
  double low = model.points[0].z(), high = low;
  for (const Vec3& p : model.points) {
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  return high - low;
}

TEST(Models, EveryShapeIsClosedFacesOutwardAndHasTheHeightAskedFor) {
  for (const char* name : {"sphere", "torus", "knot"}) {
    const auto model = shape_model(name, 40);
    ASSERT_TRUE(model) << name;
    EXPECT_NEAR(height(*model), 40, 1e-9) << name;
    EXPECT_GT(signed_volume(*model), 0) << name;
    Vec3 area = Vec3::Zero();
    for (const auto& t : model->triangles)
      area += (model->points[t[1]] - model->points[t[0]]).cross(model->points[t[2]] - model->points[t[0]]);
    EXPECT_LT(area.norm(), 1e-6) << name;
  }
  EXPECT_NEAR(signed_volume(*shape_model("sphere", 20)), 4.0 / 3 * std::numbers::pi * 1000, 2);
  EXPECT_EQ(shape_model("cube", 20).error().code, ErrorCode::InvalidInput);
}

TEST(Models, AnInsideOutOneIsTurnedRoundAndOthersStay) {
  DigitizeModel model = *shape_model("knot", 30);
  EXPECT_FALSE(face_outward(model));
  const auto right = model.triangles;
  for (auto& t : model.triangles) std::swap(t[0], t[2]);
  for (Vec3& p : model.points) p += Vec3{500, -300, 80};
  EXPECT_TRUE(face_outward(model));
  EXPECT_GT(signed_volume(model), 0);
  EXPECT_EQ(model.triangles.size(), right.size());
}

TEST(Models, ASurfelModelIsSeenWithoutGapsWhereItsCloudLies) {
  PointCloud cloud = reference_cloud(*shape_model("sphere", 20), 0.3, 1);
  const auto model = surfel_model(cloud);
  ASSERT_TRUE(model);
  const auto views = digitize(*model, {.step_deg = 90, .views = 1, .pitch_mm = 0.25, .tilt_deg = 0}, {});
  ASSERT_TRUE(views);
  double farthest = 0;
  for (const auto& p : (*views)[0].points)
    farthest =
        std::max(farthest, std::abs(((*views)[0].scanner_to_model * p.cast<double>() - Vec3{0, 0, 10}).norm() - 10));
  EXPECT_LT(farthest, 0.12);
  // The disc of radius 10, but for its rim.
  EXPECT_GT(static_cast<double>((*views)[0].points.size()), 0.95 * std::numbers::pi * 100 / (0.25 * 0.25));
  cloud.normals.clear();
  EXPECT_EQ(surfel_model(cloud).error().code, ErrorCode::InvalidInput);
}

TEST(Models, TheReferenceLiesOnTheModelWithItsNormals) {
  const PointCloud cloud = reference_cloud(*shape_model("sphere", 20), 0.5, 7);
  EXPECT_NEAR(static_cast<double>(cloud.size()), 4 * std::numbers::pi * 100 / 0.25, 60);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 out = cloud.points[i].cast<double>() - Vec3{0, 0, 10};
    EXPECT_NEAR(out.norm(), 10, 0.01);
    EXPECT_GT(out.normalized().dot(cloud.normals[i].cast<double>()), 0.999);
  }
}

}  // namespace
}  // namespace telefab::scan
