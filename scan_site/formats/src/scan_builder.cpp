// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_builder.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

#include "coarse_steps.hpp"

namespace telefab::scan {
namespace {

constexpr double kMaxCoordinate = 1e12;
/// So many points at exactly 0 0 0 are no surface but rays that met nothing.
constexpr std::size_t kZeroHeap = 10;
/// Of fewer normals it cannot be said that they are all the same by a mistake,
constexpr std::size_t kFewNormals = 8;
/// which they are when they differ by less (square of a length).
constexpr float kSameNormal = 1e-6F;
/// Thickness over size of points that lie on one plane.
constexpr float kFlat = 0.01F;

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

bool ScanBuilder::has_zero_heap() const {
  if (points_are_corners_) return false;
  const auto zeros = static_cast<std::size_t>(
      std::count_if(points_.begin(), points_.end(), [](const Vec3& p) { return p.isZero(0); }));
  return zeros >= kZeroHeap && zeros < points_.size();
}

/// Closes the gaps that points which are NaN, or mark a cell without return, leave in every list.
void ScanBuilder::leave_out_unseen() {
  const bool drop_zeros = zeros_are_no_return_ || has_zero_heap();
  constexpr std::uint32_t kGone = UINT32_MAX;
  const auto is_unseen = [&](const Vec3& p) { return p.array().isNaN().any() || (drop_zeros && p.isZero(0)); };
  if (std::none_of(points_.begin(), points_.end(), is_unseen)) return;
  const bool normals = normals_.size() == points_.size(), confidence = confidence_.size() == points_.size();
  const bool sheets = sheets_apart_.size() == points_.size();
  std::vector<std::uint32_t> place(points_.size(), kGone);
  std::size_t kept = 0, zeros = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (is_unseen(points_[i])) {
      zeros += points_[i].isZero(0) ? 1 : 0;
      continue;
    }
    place[i] = static_cast<std::uint32_t>(kept);
    points_[kept] = points_[i];
    if (normals) normals_[kept] = normals_[i];
    if (confidence) confidence_[kept] = confidence_[i];
    if (sheets) sheets_apart_[kept] = sheets_apart_[i];
    ++kept;
  }
  const std::size_t all = points_.size(), nans = all - kept - zeros;
  empty_returns_ += all - kept;
  if (nans > 0) note(ScanRemark::PointsLeftOut, fmt::format("{} of {} points are NaN and are left out", nans, all));
  if (zeros > 0)
    note(ScanRemark::PointsLeftOut,
         fmt::format("{} of {} points are 0 0 0, the mark of no return, and are left out", zeros, all));
  points_.resize(kept);
  if (normals) normals_.resize(kept);
  if (confidence) confidence_.resize(kept);
  if (sheets) sheets_apart_.resize(kept);
  for (RangeView& view : views_)
    for (std::int32_t& cell : view.point_at)
      if (cell >= 0) {
        const std::uint32_t at = place[static_cast<std::size_t>(cell)];
        cell = at == kGone ? RangeView::kEmpty : static_cast<std::int32_t>(at);
      }
  std::erase_if(faces_, [&](auto& face) {
    for (std::uint32_t& corner : face) corner = place[corner];
    return std::find(face.begin(), face.end(), kGone) != face.end();
  });
}

/// Unit vectors, zero where there is none; nothing if they cannot be normals: all the same of points on no plane.
std::vector<Eigen::Vector3f> ScanBuilder::unit_normals(std::span<const Eigen::Vector3f> points) {
  for (Eigen::Vector3f& n : normals_) {
    const float length = n.norm();
    n = length > 1e-6F && std::isfinite(length) ? Eigen::Vector3f{n / length} : Eigen::Vector3f::Zero();
  }
  if (normals_.size() < kFewNormals) return std::move(normals_);
  const auto differs = [&](const Eigen::Vector3f& n) { return (n - normals_.front()).squaredNorm() > kSameNormal; };
  if (std::any_of(normals_.begin(), normals_.end(), differs)) return std::move(normals_);
  const auto along = [&](const Eigen::Vector3f& p) { return p.dot(normals_.front()); };
  float low = along(points[0]), high = low, size = 0;
  for (const Eigen::Vector3f& p : points) {
    low = std::min(low, along(p));
    high = std::max(high, along(p));
    size = std::max(size, (p - points[0]).norm());
  }
  if (high - low < kFlat * size) return std::move(normals_);
  if (!normals_.front().isZero(0))
    note(ScanRemark::NotNormals,
         fmt::format("all {} normals are ({:.3g}, {:.3g}, {:.3g}): no surface has such; they are estimated instead",
                     normals_.size(), normals_.front().x(), normals_.front().y(), normals_.front().z()));
  return {};
}

Result<ScanFile> ScanBuilder::finish() && {
  for (const auto& face : faces_)
    for (const std::uint32_t corner : face)
      if (corner >= points_.size())
        return fail(ErrorCode::InvalidInput, fmt::format("a face names point {} of {}", corner, points_.size()));
  if (points_.size() > options_.max_points)
    return fail(ErrorCode::TooLarge, fmt::format("{} points; the limit is {}", points_.size(), options_.max_points));
  leave_out_unseen();
  if (points_.empty()) {
    if (empty_returns_ > 0)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("none of the {} points is valid (all NaN or not seen)", empty_returns_));
    return fail(ErrorCode::InvalidInput, "the file holds no point");
  }

  Vec3 low = points_[0], high = points_[0];
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const Vec3& p = points_[i];
    if (!(p.cwiseAbs().maxCoeff() <= kMaxCoordinate))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("point {} is ({}, {}, {}): coordinates must be finite and within +-{:g}; repair or clean "
                              "the file first",
                              i, p.x(), p.y(), p.z(), kMaxCoordinate));
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }

  ScanFile file;
  file.faces = std::move(faces_);
  file.format = format_;
  file.empty_returns = empty_returns_;
  file.views = std::move(views_);
  PointCloud& cloud = file.cloud;
  if (auto coarse = coarse_steps_of(points_)) {
    cloud.rounding = coarse->step;
    note(ScanRemark::CoarseCoordinates, std::move(coarse->text));
  }
  for (int axis = 0; axis < 3; ++axis)
    cloud.origin[axis] = origin_of_axis(low[axis], high[axis], (high - low).maxCoeff());
  cloud.unit_mm = unit_mm_;
  cloud.points.resize(points_.size());
  std::transform(points_.begin(), points_.end(), cloud.points.begin(),
                 [&](const Vec3& p) -> Eigen::Vector3f { return (p - cloud.origin).cast<float>(); });
  points_ = {};

  if (normals_.size() == cloud.size()) cloud.normals = unit_normals(cloud.points);
  if (confidence_.size() == cloud.size()) {
    float top = 1;
    for (const float c : confidence_)
      if (std::isfinite(c)) top = std::max(top, c);
    for (float& c : confidence_) c = std::isfinite(c) ? std::max(0.F, c / top) : 0.F;
    cloud.confidence = std::move(confidence_);
  }
  if (sheets_apart_.size() == cloud.size()) {
    for (float& apart : sheets_apart_) apart = std::isfinite(apart) ? std::max(0.F, apart) : 0.F;
    cloud.sheets_apart = std::move(sheets_apart_);
  }
  cloud.notes = std::move(notes_);
  return file;
}

}  // namespace telefab::scan
