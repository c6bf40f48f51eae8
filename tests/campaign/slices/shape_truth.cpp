// SPDX-License-Identifier: GPL-3.0-or-later
#include "shape_truth.hpp"

#include <fmt/format.h>

#include <telefab/test/surface_samples.hpp>

namespace telefab::campaign {
namespace {

/// The analytic field answers within three of these of its surface.
constexpr double kReachMm = 4;

test::Shape shape_of(std::string_view name, int turn) {
  const auto pose = test::Pose::turned(35.0 * turn, Vec3{1, 0.5, 0.2});
  if (name == "torus") return test::torus(18, 7, 40 + 35 * turn, kReachMm);
  if (name == "genus-two") return test::genus_two(23, kReachMm, pose);
  if (name == "bumpy") return test::bumpy(25, kReachMm);
  if (name == "balls") return test::near_touching_balls(15, 0.3, kReachMm);
  if (name == "wall") return test::thin_wall(30, 50, 1, kReachMm);
  if (name == "gyroid") return test::gyroid_ball(25, 20, kReachMm);
  return nullptr;
}

}  // namespace

ShapeTruth::ShapeTruth(test::Shape shape) : shape_{std::move(shape)}, cursor_{shape_->cursor()} {}

Result<ShapeTruth> ShapeTruth::named(std::string_view name, int turn) {
  auto shape = shape_of(name, turn);
  if (!shape)
    return fail(ErrorCode::InvalidInput,
                fmt::format("no shape named \"{}\"; there are torus, genus-two, bumpy, balls, wall, gyroid", name));
  return ShapeTruth{std::move(shape)};
}

double ShapeTruth::spacing_of(std::size_t samples) const {
  const double area = test::sample_surface(*shape_, {.spacing_mm = 0.8, .seed = 1}).area_mm2;
  return std::sqrt(area / static_cast<double>(samples));
}

scan::PointCloud ShapeTruth::sampled(double spacing, double noise, double normal_noise, std::uint64_t seed) const {
  const auto samples = test::sample_surface(
      *shape_, {.spacing_mm = spacing, .noise_mm = noise, .normal_noise_rad = normal_noise, .seed = seed});
  scan::PointCloud cloud;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    cloud.points.push_back(samples.points[i].cast<float>());
    cloud.normals.push_back(samples.normals[i].cast<float>());
  }
  return cloud;
}

void ShapeTruth::place(const Transform4& matrix) {
  Eigen::Affine3d placed;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c) placed.matrix()(r, c) = matrix[static_cast<std::size_t>(4 * r + c)];
  placed.makeAffine();
  to_shape_ = placed.inverse();
  scale_ = std::cbrt(placed.linear().determinant());
}

RingCount ShapeTruth::rings(double z) const {
  const scan::Box3 box = shape_->bounds();
  const auto count =
      test::count_slice(*shape_, (to_shape_ * Vec3{0, 0, z}).z(), (box.max - box.min).head<2>().maxCoeff() / 600);
  return {count.outers, count.holes};
}

double ShapeTruth::distance(const Vec3& place) const {
  const Vec3 start = to_shape_ * place;
  Vec3 p = start;
  for (int i = 0; i < 4; ++i) {
    const auto f = cursor_->at(p);
    if (!f.in_reach) return scale_ * 3 * kReachMm;
    p -= f.value_mm / f.gradient.squaredNorm() * f.gradient;
  }
  return scale_ * (p - start).norm();
}

}  // namespace telefab::campaign
