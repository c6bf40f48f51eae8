// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_builder.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

#include "coarse_steps.hpp"

namespace telefab::scan {
namespace {

constexpr double kMaxCoordinate = 1e12;
constexpr std::size_t kAllOfThem = SIZE_MAX;
/// So much more than what is kept is read before it is thinned, in parts of that.
constexpr std::size_t kMorePart = 8;
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

tl::unexpected<Error> beyond_reach(std::uint64_t number, const Vec3& p) {
  return fail(ErrorCode::InvalidInput,
              fmt::format("point {} is ({}, {}, {}): coordinates must be finite and within +-{:g}; repair or clean "
                          "the file first",
                          number, p.x(), p.y(), p.z(), kMaxCoordinate));
}

}  // namespace

ScanBuilder::ScanBuilder(ScanFormat format, const ReadOptions& options)
    : format_{format}, options_{options}, full_at_{options.most_points ? 2 * *options.most_points : kAllOfThem} {}

void ScanBuilder::points_are_named() { full_at_ = kAllOfThem; }

void ScanBuilder::set_unseen_aside() {
  PointLists all = lists();
  std::size_t kept = thinning_->kept();
  const std::uint64_t first = aside_.points - kept;
  aside_.points = first + points_.size();
  for (std::size_t i = kept; i < points_.size(); ++i) {
    const Vec3& p = points_[i];
    if (p.array().isNaN().any()) {
      ++aside_.nans;
    } else if (p.isZero(0)) {
      if (aside_.zeros++ == 0 && !normals_.empty()) aside_.zero_normal = normals_[i];
    } else if (p.cwiseAbs().maxCoeff() > kMaxCoordinate) {
      if (!aside_.beyond) aside_.beyond = {first + i, p};
    } else {
      all.copy(i, kept++);
      // Of no side: one that is compared with nothing would never be stood for.
      if (!normals_.empty() && !normals_[kept - 1].allFinite()) normals_[kept - 1].setZero();
    }
  }
  lists().resize(kept);
}

void ScanBuilder::thin() {
  PointLists all = lists();
  if (!all.are_level()) {  // what belongs to a point comes in another place of the file
    full_at_ = kAllOfThem;
    return;
  }
  const bool is_first = !thinning_;
  if (is_first) thinning_.emplace(*options_.most_points);
  set_unseen_aside();
  if (is_first && !points_.empty()) coarse_ = coarse_steps_of(points_);
  if (points_.size() > thinning_->kept()) thinning_->take_in(all);
  full_at_ = thinning_->kept() + *options_.most_points / kMorePart + 1;
  if (options_.let_go) options_.let_go();
}

Result<void> ScanBuilder::finish_thinning() {
  // As finish() does with lists that do not belong to the points.
  if (normals_.size() != points_.size()) normals_.clear();
  if (confidence_.size() != points_.size()) confidence_.clear();
  if (sheets_apart_.size() != points_.size()) sheets_apart_.clear();
  set_unseen_aside();
  if (aside_.beyond) return beyond_reach(aside_.beyond->first, aside_.beyond->second);
  const bool zeros_are_unseen =
      zeros_are_no_return_ || (!points_are_corners_ && aside_.zeros >= kZeroHeap && aside_.zeros < aside_.points);
  if (aside_.zeros > 0 && !zeros_are_unseen) {
    points_.push_back(Vec3::Zero());
    if (!normals_.empty()) normals_.push_back(aside_.zero_normal);
    if (!confidence_.empty()) confidence_.push_back(0);
    if (!sheets_apart_.empty()) sheets_apart_.push_back(0);
  }
  note_unseen(aside_.nans, zeros_are_unseen ? aside_.zeros : 0, aside_.points);
  PointLists all = lists();
  if (points_.size() > thinning_->kept()) thinning_->take_in(all);
  thinning_->finish(all);
  // They name points by the numbers these had.
  views_.clear();
  note(ScanRemark::Thinned,
       fmt::format("of the {} points of the file {} are taken, {:.3g} apart at least; each stands for those about it",
                   aside_.points, points_.size(), thinning_->reach()));
  return {};
}

Result<void> ScanBuilder::expect(std::uint64_t count, std::uint64_t bytes_left, std::uint64_t bytes_each) {
  if (bytes_each == 0) bytes_each = 1;
  if (count > bytes_left / bytes_each)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the header claims {} points of at least {} bytes but only {} bytes follow; the file is "
                            "truncated or its header is wrong",
                            count, bytes_each, bytes_left));
  if (full_at_ == kAllOfThem && count + points_.size() > options_.max_points)
    return fail(ErrorCode::TooLarge, fmt::format("{} points; the limit is {}", count, options_.max_points));
  points_.reserve(std::min(points_.size() + count, full_at_));
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

void ScanBuilder::note_unseen(std::size_t nans, std::size_t zeros, std::size_t all) {
  empty_returns_ += nans + zeros;
  if (nans > 0) note(ScanRemark::PointsLeftOut, fmt::format("{} of {} points are NaN and are left out", nans, all));
  if (zeros > 0)
    note(ScanRemark::PointsLeftOut,
         fmt::format("{} of {} points are 0 0 0, the mark of no return, and are left out", zeros, all));
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
  note_unseen(points_.size() - kept - zeros, zeros, points_.size());
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
  if (thinning_)
    if (auto ok = finish_thinning(); !ok) return tl::unexpected{ok.error()};
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
    if (!(p.cwiseAbs().maxCoeff() <= kMaxCoordinate)) return beyond_reach(i, p);
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }

  ScanFile file;
  file.faces = std::move(faces_);
  file.format = format_;
  file.empty_returns = empty_returns_;
  file.views = std::move(views_);
  PointCloud& cloud = file.cloud;
  if (!thinning_) coarse_ = coarse_steps_of(points_);
  if (coarse_) {
    cloud.rounding = coarse_->step;
    note(ScanRemark::CoarseCoordinates, std::move(coarse_->text));
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
