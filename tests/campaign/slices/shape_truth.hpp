// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/test/analytic_field.hpp>

#include <telefab/test/mesh_truth.hpp>

namespace telefab::campaign {

using test::RingCount;
using test::Vec3;

/// A surface known by its formula as the truth about a scan made of it. Copies share the surface.
class ShapeTruth {
 public:
  /// torus, genus-two, bumpy, balls (0.3 mm apart), wall (1 mm thick), gyroid; about 50 mm each. Other turns than 0
  /// lean the shape by so many times 35 degrees. Fails: InvalidInput (lists the names).
  [[nodiscard]] static Result<ShapeTruth> named(std::string_view name, int turn);

  /// The mean spacing sqrt(area / points) at which about so many samples cover the surface.
  [[nodiscard]] double spacing_of(std::size_t samples) const;
  /// Even samples with their exact normals, moved by Gaussian noise; normals tilted by `normal_noise` radians.
  [[nodiscard]] scan::PointCloud sampled(double spacing, double noise, double normal_noise, std::uint64_t seed) const;

  /// Rings and distances from here on are those of the shape moved by this similarity.
  void place(const Transform4& matrix);
  /// Counted on a grid of inside and outside, a 600th of the longest side wide.
  [[nodiscard]] RingCount rings(double z) const;
  /// Distance to the surface, by Newton steps along its gradient; exact to second order near the surface.
  [[nodiscard]] double distance(const Vec3& place) const;
  [[nodiscard]] int euler() const { return shape_->facts().euler.value_or(0); }

 private:
  explicit ShapeTruth(test::Shape shape);

  std::shared_ptr<const test::AnalyticField> shape_;
  std::shared_ptr<scan::FieldCursor> cursor_;
  Eigen::Affine3d to_shape_ = Eigen::Affine3d::Identity();
  double scale_ = 1;  ///< placed millimetres per shape millimetre
};

}  // namespace telefab::campaign
