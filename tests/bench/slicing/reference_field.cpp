// SPDX-License-Identifier: GPL-3.0-or-later
#include "reference_field.hpp"

#include <cmath>
#include <nanoflann.hpp>
#include <utility>
#include <vector>

namespace telefab::bench {
namespace {

using scan::Vec3;

struct Points {
  std::vector<Vec3> places;
  std::vector<Vec3> normals;
  [[nodiscard]] std::size_t kdtree_get_point_count() const { return places.size(); }
  [[nodiscard]] double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return places[i][static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>, Points, 3, std::size_t>;

class ReferenceCursor final : public scan::FieldCursor {
 public:
  ReferenceCursor(const Points& points, const Tree& tree, double h) : points_{points}, tree_{tree}, h_{h} {}

  scan::FieldSample at(const Vec3& x) override {
    tree_.radiusSearch(x.data(), 10 * h_ * h_, found_, nanoflann::SearchParams{32, 0, false});
    const double k = 1 / (h_ * h_);
    double w = 0, plane = 0, square = 0;
    Vec3 normal = Vec3::Zero(), place = Vec3::Zero();
    for (const auto& [i, r2] : found_) {
      const double theta = std::exp(-r2 * k);
      const Vec3 p = points_.places[i] - x;
      w += theta;
      normal += theta * points_.normals[i];
      place += theta * p;
      plane += theta * p.dot(points_.normals[i]);
      square += theta * r2;
    }
    scan::FieldSample sample;
    if (!(w > 0.02)) return sample;
    const double length = normal.norm();
    const Vec3 n = normal / length;
    const double pn = place.dot(n);
    const double mean = -(plane + pn) / (2 * w);
    const Vec3 side = (place - pn * n) / length;
    Vec3 sum = Vec3::Zero();
    for (const auto& [i, r2] : found_) {
      const Vec3 p = points_.places[i] - x;
      sum += 2 * k * std::exp(-r2 * k) *
             (2 * mean + p.dot(points_.normals[i]) + p.dot(n) + points_.normals[i].dot(side)) * p;
    }
    const double place2 = place.squaredNorm() / (w * w);
    const double kappa = (plane / w - place.dot(normal) / (w * w)) / std::max(square / w - place2, 1e-12);
    sample.value_mm = mean + 0.5 * kappa * (place2 - pn * pn / (w * w));
    sample.gradient = (normal + w * n - sum) / (2 * w);
    sample.closeness_mm = -plane / w;
    sample.in_reach = true;
    return sample;
  }

 private:
  const Points& points_;
  const Tree& tree_;
  double h_;
  std::vector<std::pair<std::size_t, double>> found_;
};

class ReferenceField final : public scan::ScalarField {
 public:
  ReferenceField(Points points, double kernel_mm)
      : points_{std::move(points)}, tree_{3, points_, nanoflann::KDTreeSingleIndexAdaptorParams{16}}, h_{kernel_mm} {
    tree_.buildIndex();
    box_.min = box_.max = points_.places[0];
    for (const Vec3& p : points_.places) {
      box_.min = box_.min.cwiseMin(p);
      box_.max = box_.max.cwiseMax(p);
    }
  }
  std::unique_ptr<scan::FieldCursor> cursor() const override {
    return std::make_unique<ReferenceCursor>(points_, tree_, h_);
  }
  scan::Box3 bounds() const override { return box_; }
  double kernel_width_mm(const Vec3&) const override { return h_; }

 private:
  Points points_;
  Tree tree_;
  double h_;
  scan::Box3 box_;
};

}  // namespace

std::unique_ptr<scan::ScalarField> reference_field(const scan::PointCloud& cloud, double kernel_mm) {
  Points points;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    points.places.push_back(cloud.origin + cloud.points[i].cast<double>());
    points.normals.push_back(cloud.normals[i].cast<double>());
  }
  return std::make_unique<ReferenceField>(std::move(points), kernel_mm);
}

}  // namespace telefab::bench
