// SPDX-License-Identifier: GPL-3.0-or-later
#include "hermite_field.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace telefab::scan {

using Eigen::Vector3d;

namespace {
/// In units of the places' extent.
constexpr double kSlack = 1e-6;
}  // namespace

std::optional<HermiteField> HermiteField::through(std::span<const Eigen::Vector3f> places,
                                                  std::span<const Eigen::Vector3f> normals) {
  const auto count = static_cast<Eigen::Index>(places.size());
  if (count < 4) return std::nullopt;
  HermiteField field;
  for (const auto& p : places) field.origin_ += p.cast<double>() / static_cast<double>(count);
  double extent = 0;
  for (const auto& p : places) extent = std::max(extent, (p.cast<double>() - field.origin_).norm());
  if (!(extent > 0)) return std::nullopt;
  field.unit_ = extent;
  for (const auto& p : places)
    field.terms_.push_back({(p.cast<double>() - field.origin_) / extent, Vector3d::Zero(), 0});
  const Eigen::Index size = 4 * count + 4;
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd wanted = Eigen::VectorXd::Zero(size);
  for (Eigen::Index j = 0; j < count; ++j) {
    const Vector3d& place = field.terms_[static_cast<std::size_t>(j)].place;
    for (Eigen::Index i = 0; i < count; ++i) {
      const Vector3d d = field.terms_[static_cast<std::size_t>(i)].place - place;
      const double r = d.norm();
      if (r > 0) {
        rows(4 * i, 4 * j) = r * r * r;
        rows.block<1, 3>(4 * i, 4 * j + 1) = -3 * r * d.transpose();
        rows.block<3, 1>(4 * i + 1, 4 * j) = 3 * r * d;
        rows.block<3, 3>(4 * i + 1, 4 * j + 1) = -3 * (r * Eigen::Matrix3d::Identity() + d * d.transpose() / r);
      }
    }
    // What single samples are off must not tear the function between them.
    rows.block<4, 4>(4 * j, 4 * j) += kSlack * Eigen::Matrix4d::Identity();
    rows(4 * j, 4 * count) = rows(4 * count, 4 * j) = 1;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      rows(4 * j, 4 * count + 1 + axis) = rows(4 * count + 1 + axis, 4 * j) = place[axis];
      rows(4 * j + 1 + axis, 4 * count + 1 + axis) = rows(4 * count + 1 + axis, 4 * j + 1 + axis) = 1;
    }
    wanted.segment<3>(4 * j + 1) = normals[static_cast<std::size_t>(j)].cast<double>();
  }
  const Eigen::VectorXd found = rows.partialPivLu().solve(wanted);
  if (!found.allFinite()) return std::nullopt;
  for (Eigen::Index j = 0; j < count; ++j) {
    field.terms_[static_cast<std::size_t>(j)].weight = found[4 * j];
    field.terms_[static_cast<std::size_t>(j)].dipole = found.segment<3>(4 * j + 1);
  }
  field.constant_ = found[4 * count];
  field.slope_ = found.tail<3>();
  return field;
}

HermiteField::Value HermiteField::at(const Eigen::Vector3f& place) const {
  const Vector3d x = (place.cast<double>() - origin_) / unit_;
  double sum = constant_ + slope_.dot(x);
  Vector3d gradient = slope_;
  for (const Term& t : terms_) {
    const Vector3d d = x - t.place;
    const double r2 = d.squaredNorm(), r = std::sqrt(r2), along = t.dipole.dot(d);
    sum += r * (t.weight * r2 - 3 * along);
    gradient += 3 * (t.weight * r - (r > 0 ? along / r : 0)) * d - 3 * r * t.dipole;
  }
  return {static_cast<float>(unit_ * sum), gradient.cast<float>()};
}

}  // namespace telefab::scan
