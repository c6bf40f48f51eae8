// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_builder.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace telefab::scan {
namespace {

constexpr double kMaxCoordinate = 1e12;

/// Zero unless the cloud lies far from it, compared with its size; then a coarse round number near the middle, so
/// that the subtraction is exact for coordinates that were floats.
double origin_of_axis(double low, double high, double extent) {
  const double far = std::max(std::abs(low), std::abs(high));
  if (far <= 8 * extent) return 0;
  const double grain = std::exp2(std::ceil(std::log2(std::max({extent, far * 1e-7, 1e-12}))));
  return std::round((low + high) / 2 / grain) * grain;
}

}  // namespace

Result<void> ScanBuilder::expect(std::uint64_t count, std::uint64_t bytes_left, std::uint64_t bytes_each) {
  if (bytes_each == 0) bytes_each = 1;
  if (count > bytes_left / bytes_each)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the header claims {} points of at least {} bytes but only {} bytes follow; the file is "
                            "truncated or its header is wrong",
                            count, bytes_each, bytes_left));
  if (count + points_.size() > options_.max_points)
    return fail(ErrorCode::TooLarge, fmt::format("{} points; the limit is {}", count, options_.max_points));
  points_.reserve(points_.size() + count);
  return {};
}

void ScanBuilder::add_face(std::span<const std::uint64_t> corners) {
  const auto clipped = [&](std::size_t i) {
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(corners[i], UINT32_MAX));
  };
  for (std::size_t i = 2; i < corners.size() && options_.keep_faces; ++i)
    faces_.push_back({clipped(0), clipped(i - 1), clipped(i)});
}

Result<ScanFile> ScanBuilder::finish() && {
  if (points_.empty()) {
    if (empty_returns_ > 0)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("none of the {} points is valid (all NaN or not seen)", empty_returns_));
    return fail(ErrorCode::InvalidInput, "the file holds no point");
  }
  if (points_.size() > options_.max_points)
    return fail(ErrorCode::TooLarge, fmt::format("{} points; the limit is {}", points_.size(), options_.max_points));

  Vec3 low = points_[0], high = points_[0];
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const Vec3& p = points_[i];
    if (!(p.cwiseAbs().maxCoeff() <= kMaxCoordinate) || !p.allFinite())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("point {} is ({}, {}, {}): coordinates must be finite and within +-{:g}; repair or clean "
                              "the file first",
                              i, p.x(), p.y(), p.z(), kMaxCoordinate));
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }

  for (const auto& face : faces_)
    for (const std::uint32_t corner : face)
      if (corner >= points_.size())
        return fail(ErrorCode::InvalidInput, fmt::format("a face names point {} of {}", corner, points_.size()));

  ScanFile file;
  file.faces = std::move(faces_);
  file.format = format_;
  file.empty_returns = empty_returns_;
  file.views = std::move(views_);
  for (int axis = 0; axis < 3; ++axis)
    file.cloud.origin[axis] = origin_of_axis(low[axis], high[axis], (high - low).maxCoeff());
  file.cloud.unit_mm = unit_mm_;
  file.cloud.points.resize(points_.size());
  std::transform(points_.begin(), points_.end(), file.cloud.points.begin(),
                 [&](const Vec3& p) -> Eigen::Vector3f { return (p - file.cloud.origin).cast<float>(); });
  points_ = {};

  if (normals_.size() == file.cloud.size()) {
    for (Eigen::Vector3f& n : normals_) {
      const float length = n.norm();
      n = length > 1e-6F && std::isfinite(length) ? Eigen::Vector3f{n / length} : Eigen::Vector3f::Zero();
    }
    file.cloud.normals = std::move(normals_);
  }
  if (confidence_.size() == file.cloud.size()) {
    float top = 1;
    for (const float c : confidence_)
      if (std::isfinite(c)) top = std::max(top, c);
    for (float& c : confidence_) c = std::isfinite(c) ? std::max(0.F, c / top) : 0.F;
    file.cloud.confidence = std::move(confidence_);
  }
  return file;
}

}  // namespace telefab::scan
