// SPDX-License-Identifier: GPL-3.0-or-later
#include "thinning.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace telefab::scan {
namespace {

constexpr std::uint32_t kNone = UINT32_MAX;
/// Where too many are kept the reach grows until about this share of what may be kept is: more come.
constexpr double kShareKept = 0.75;

/// How wide some coordinates spread, by the nine tenths in the middle: strays on either side do not widen it.
double extent_of(std::vector<double>& values) {
  const auto at = [&](double share) {
    const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::ranges::nth_element(values, place);
    return *place;
  };
  const double low = at(0.05);
  return (at(0.95) - low) / 0.9;
}

/// A first idea, from the box of most of the points: rather too small, for the reach only grows, and not much, for
/// every growth lets points stand for what lies farther away.
double spacing_of(std::span<const Vec3> points) {
  constexpr std::size_t kSome = 65'536;
  const std::size_t step = points.size() / kSome + 1;
  Vec3 size;
  double widest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (std::size_t i = 0; i < points.size(); i += step) values.push_back(points[i][axis]);
    const auto [low, high] = std::ranges::minmax(values);
    widest = std::max(widest, high - low);
    size[axis] = extent_of(values);
  }
  const double area = 2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
  return std::max(
      {std::sqrt(area / static_cast<double>(points.size())), size.maxCoeff() * 1e-7, widest * 1e-12, 1e-300});
}

Eigen::Vector3f normal_of(const PointLists& lists, std::size_t i) {
  return lists.normals.empty() ? Eigen::Vector3f{Eigen::Vector3f::Zero()} : lists.normals[i];
}

/// Files may hold normals of any length.
Eigen::Vector3f unit(const Eigen::Vector3f& n) {
  const float length = n.norm();
  return length > 1e-6F && std::isfinite(length) ? Eigen::Vector3f{n / length}
                                                 : Eigen::Vector3f{Eigen::Vector3f::Zero()};
}

}  // namespace

void PointLists::copy(std::size_t from, std::size_t to) {
  if (from == to) return;
  points[to] = points[from];
  if (!normals.empty()) normals[to] = normals[from];
  if (!confidence.empty()) confidence[to] = confidence[from];
  if (!sheets_apart.empty()) sheets_apart[to] = sheets_apart[from];
}

void PointLists::resize(std::size_t count) {
  points.resize(count);
  if (!normals.empty()) normals.resize(count);
  if (!confidence.empty()) confidence.resize(count);
  if (!sheets_apart.empty()) sheets_apart.resize(count);
}

std::size_t Thinning::slot_of(const Cell& cell) const { return slot_of(AxisKeys{cell, 0}, 0, 0, 0); }

std::size_t Thinning::slot_of(const AxisKeys& keys, std::size_t x, std::size_t y, std::size_t z) const {
  std::uint64_t h = keys.x[x] ^ keys.y[y] ^ keys.z[z];
  h = (h ^ (h >> 32U)) * 0x94D049BB133111EBULL;
  return (h ^ (h >> 31U)) & (first_.size() - 1);
}

std::uint32_t Thinning::near(const PointLists& lists, const Vec3& p, const Eigen::Vector3f& normal) const {
  const double reach2 = reach_ * reach_;
  const Vec3 at = (p - from_) / reach_;
  const Cell own = cell_of(p);
  const AxisKeys keys{own, 1};
  const auto in = [&](std::size_t x, std::size_t y, std::size_t z) {
    // Other cells may share the slot: their points are farther than the reach, or as good.
    for (std::uint32_t k = first_[slot_of(keys, x, y, z)]; k != kNone; k = next_[k])
      if ((lists.points[k] - p).squaredNorm() < reach2 && normal_of(lists, k).dot(normal) >= 0) return k;
    return kNone;
  };
  if (const std::uint32_t found = in(1, 1, 1); found != kNone) return found;
  // Of the cells about it only those that the reach touches.
  std::array<std::array<double, 3>, 3> away2;
  for (int axis = 0; axis < 3; ++axis) {
    const double within = at[axis] - own[axis];
    away2[static_cast<std::size_t>(axis)] = {within * within, 0, (1 - within) * (1 - within)};
  }
  for (std::size_t x = 0; x < 3; ++x)
    for (std::size_t y = 0; y < 3; ++y)
      for (std::size_t z = 0; z < 3; ++z) {
        if ((x == 1 && y == 1 && z == 1) || away2[0][x] + away2[1][y] + away2[2][z] >= 1) continue;
        if (const std::uint32_t found = in(x, y, z); found != kNone) return found;
      }
  return kNone;
}

void Thinning::stand_for(const PointLists& lists, std::uint32_t kept, std::size_t other, Mean& mean, const Mean& more) {
  const float count = mean.count + more.count;
  if (!lists.normals.empty()) {
    const Vec3 place = lists.points[other] + (more.height * unit(lists.normals[other])).cast<double>();
    // Square to the mean of both normals lies the chord of a round surface: its curvature moves nothing.
    const Eigen::Vector3f axis = (unit(lists.normals[kept]) + unit(more.normal)) / 2;
    const auto height = static_cast<float>((place - lists.points[kept]).dot(axis.cast<double>()));
    mean.height += more.count / count * (height - mean.height);
    mean.normal += more.normal;
  }
  mean.count = count;
  if (!lists.confidence.empty()) lists.confidence[kept] = std::max(lists.confidence[kept], lists.confidence[other]);
  if (!lists.sheets_apart.empty())
    lists.sheets_apart[kept] = std::max(lists.sheets_apart[kept], lists.sheets_apart[other]);
}

void Thinning::keep(const PointLists& lists, std::uint32_t at) {
  const std::size_t slot = slot_of(cell_of(lists.points[at]));
  next_.push_back(first_[slot]);
  first_[slot] = at;
}

void Thinning::begin_with(double reach, std::size_t room) {
  reach_ = reach;
  first_.assign(std::bit_ceil(2 * room), kNone);
  next_.clear();
  means_.clear();
}

/// Of the points from `first` on, each with what it stands for, some stay behind those that are kept.
void Thinning::absorb(PointLists& lists, std::size_t first, std::vector<Mean> means) {
  const std::size_t end = first + means.size();
  // Most lie near one that is there already; that is asked in parallel.
  std::vector<std::uint32_t> known(means.size(), kNone);
  if (!means_.empty())
    tbb::parallel_for(tbb::blocked_range<std::size_t>{first, end, 4096}, [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i)
        known[i - first] = near(lists, lists.points[i], normal_of(lists, i));
    });
  std::size_t kept = means_.size();
  for (std::size_t i = first; i < end; ++i) {
    std::uint32_t by = known[i - first];
    if (by == kNone) by = near(lists, lists.points[i], normal_of(lists, i));
    if (by != kNone) {
      stand_for(lists, by, i, means_[by], means[i - first]);
      continue;
    }
    lists.copy(i, kept);
    means_.push_back(means[i - first]);
    keep(lists, static_cast<std::uint32_t>(kept++));
  }
}

void Thinning::take_in(PointLists& lists) {
  const std::size_t before = kept();
  std::vector<Mean> means(lists.points.size() - before);
  if (!lists.normals.empty())
    for (std::size_t i = 0; i < means.size(); ++i) means[i].normal = unit(lists.normals[before + i]);
  if (reach_ == 0) {
    from_ = lists.points[0];
    begin_with(spacing_of(lists.points), lists.points.size());
  }
  absorb(lists, before, std::move(means));
  while (kept() > most_) {
    std::vector<Mean> all;
    all.swap(means_);
    // As many stay as there is room for on a surface.
    const double growth = std::sqrt(static_cast<double>(all.size()) / (kShareKept * static_cast<double>(most_)));
    begin_with(growth * reach_, all.size());
    absorb(lists, 0, std::move(all));
  }
  lists.resize(kept());
}

void Thinning::finish(PointLists& lists) const {
  if (lists.normals.empty()) return;
  for (std::size_t i = 0; i < kept(); ++i) {
    lists.points[i] += (means_[i].height * unit(lists.normals[i])).cast<double>();
    lists.normals[i] = means_[i].normal;
  }
}

}  // namespace telefab::scan
