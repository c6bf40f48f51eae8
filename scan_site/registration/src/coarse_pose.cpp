// SPDX-License-Identifier: GPL-3.0-or-later
#include "coarse_pose.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <tuple>

namespace telefab::scan {
namespace {

constexpr float kLeastMeanNormal = 0.6F;  ///< shorter: the cube holds two sides of something
constexpr float kDescriptorRadius = 6;    ///< cells
constexpr std::size_t kBestOf = 8;        ///< correspondences are in each other's best so many
constexpr std::size_t kLeastMeans = 50;
constexpr int kReach = 2;                                  ///< cells about a mean in which it is found
constexpr float kLeastBase = 0.2F;                         ///< of the diagonal: a shorter base turns the frame by noise
constexpr float kMostStretch = 1.5F;                       ///< cells between the two base lengths
constexpr float kMostAngle = 0.25F;                        ///< radians between the angles of base and normals
constexpr float kFacesAlike = 0.9F;                        ///< cosine of 26 degrees: normals after the move
constexpr float kSameSurface = 0.8F;                       ///< cosine for a mean to count as fitting
constexpr std::size_t kFirstLook = 80, kSecondLook = 400;  ///< means a pose is verified on
constexpr float kLeastShare = 0.12F;
constexpr double kSameTurnDeg = 8, kSameShiftCells = 3;
constexpr std::uint32_t kBlock = 2000;  ///< draws of one random sequence

/// Leaves out what lies farther from the middle nine tenths than those are large: strays must not set the size.
void leave_out_strays(OrientedPoints& means) {
  Eigen::Vector3f low, high;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<float> along;
    for (const Eigen::Vector3f& p : means.points) along.push_back(p[axis]);
    std::sort(along.begin(), along.end());
    low[axis] = along[along.size() / 20];
    high[axis] = along[along.size() - 1 - along.size() / 20];
  }
  const float reach = (high - low).norm();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < means.points.size(); ++i) {
    const Eigen::Vector3f& p = means.points[i];
    if ((p - p.cwiseMax(low).cwiseMin(high)).norm() > reach) continue;
    means.points[kept] = p;
    means.normals[kept] = means.normals[i];
    ++kept;
  }
  means.points.resize(kept);
  means.normals.resize(kept);
}

struct Correspondence {
  std::uint32_t source = 0, target = 0;
};

using Distances = Eigen::MatrixXf;

/// The kBestOf nearest columns of `to` for every column of `from`.
std::vector<std::array<std::uint32_t, kBestOf>> best_of(const Descriptors& from, const Descriptors& to) {
  std::vector<std::array<std::uint32_t, kBestOf>> best(static_cast<std::size_t>(from.cols()));
  const Eigen::VectorXf length = to.colwise().squaredNorm();
  constexpr Eigen::Index kColumns = 64;
  const Eigen::Index blocks = (from.cols() + kColumns - 1) / kColumns;
  tbb::parallel_for(Eigen::Index{0}, blocks, [&](Eigen::Index b) {
    const Eigen::Index first = b * kColumns, count = std::min(kColumns, from.cols() - first);
    const Distances distance = (-2 * to.transpose() * from.middleCols(first, count)).colwise() + length;
    for (Eigen::Index c = 0; c < count; ++c) {
      std::array<std::pair<float, std::uint32_t>, kBestOf> list;
      list.fill({std::numeric_limits<float>::max(), 0});
      for (Eigen::Index r = 0; r < distance.rows(); ++r) {
        if (!(distance(r, c) < list.back().first)) continue;
        std::size_t place = kBestOf - 1;
        for (; place > 0 && list[place - 1].first > distance(r, c); --place) list[place] = list[place - 1];
        list[place] = {distance(r, c), static_cast<std::uint32_t>(r)};
      }
      for (std::size_t k = 0; k < kBestOf; ++k) best[static_cast<std::size_t>(first + c)][k] = list[k].second;
    }
  });
  return best;
}

std::vector<Correspondence> correspondences(const CoarseShape& source, const CoarseShape& target) {
  const auto there = best_of(source.descriptors(), target.descriptors());
  const auto back = best_of(target.descriptors(), source.descriptors());
  std::vector<Correspondence> pairs;
  for (std::uint32_t i = 0; i < there.size(); ++i)
    for (const std::uint32_t j : there[i])
      if (std::ranges::find(back[j], i) != back[j].end()) pairs.push_back({i, j});
  return pairs;
}

/// x along the base, z along what is left of the mean normal.
bool frame_of(const Eigen::Vector3f& base, const Eigen::Vector3f& normal, Eigen::Matrix3f& frame) {
  const Eigen::Vector3f x = base.normalized();
  const Eigen::Vector3f z = normal - x * x.dot(normal);
  if (!(z.squaredNorm() > 1e-4F)) return false;
  frame.col(0) = x;
  frame.col(2) = z.normalized();
  frame.col(1) = frame.col(2).cross(x);
  return true;
}

float angle_between(float cosine_a, float cosine_b) {
  return std::abs(std::acos(std::clamp(cosine_a, -1.F, 1.F)) - std::acos(std::clamp(cosine_b, -1.F, 1.F)));
}

struct Draw {
  Eigen::Matrix3f turn;
  Eigen::Vector3f shift;
  float share = 0;
};

class Consensus {
 public:
  Consensus(const CoarseShape& source, const CoarseShape& target, std::vector<Correspondence> pairs)
      : source_{source}, target_{target}, pairs_{std::move(pairs)} {
    least_base_ = kLeastBase * static_cast<float>(std::min(source.diagonal(), target.diagonal()));
    stretch_ = kMostStretch * static_cast<float>(source.cell());
  }

  std::vector<Draw> block(std::uint64_t seed, std::uint32_t draws) const {
    std::mt19937_64 random{seed};
    std::vector<Draw> kept;
    float best = kLeastShare;
    for (std::uint32_t d = 0; d < draws; ++d) {
      const Correspondence& a = pairs_[random() % pairs_.size()];
      const Correspondence& b = pairs_[random() % pairs_.size()];
      Draw draw;
      if (!fits(a, b) || !move(a, b, draw)) continue;
      draw.share = share(draw, kFirstLook);
      if (draw.share < 0.4F * best) continue;
      draw.share = share(draw, kSecondLook);
      if (draw.share < 0.5F * best) continue;
      best = std::max(best, draw.share);
      if (draw.share > kLeastShare) kept.push_back(draw);
    }
    return kept;
  }

  [[nodiscard]] float share(const Draw& draw, std::size_t look) const {
    const auto& means = source_.means();
    const std::size_t count = std::min(look, means.points.size());
    std::size_t near = 0;
    for (std::size_t k = 0; k < count; ++k) {
      // a stride through all of them, the same for every draw
      const std::size_t i = k * means.points.size() / count;
      const std::int32_t hit = target_.near(draw.turn * means.points[i] + draw.shift);
      if (hit >= 0)
        near +=
            (draw.turn * means.normals[i]).dot(target_.means().normals[static_cast<std::size_t>(hit)]) > kSameSurface
                ? 1
                : 0;
    }
    return static_cast<float>(near) / static_cast<float>(count);
  }

 private:
  [[nodiscard]] bool fits(const Correspondence& a, const Correspondence& b) const {
    const auto& s = source_.means();
    const auto& t = target_.means();
    const Eigen::Vector3f base_s = s.points[b.source] - s.points[a.source],
                          base_t = t.points[b.target] - t.points[a.target];
    const float length_s = base_s.norm(), length_t = base_t.norm();
    if (length_s < least_base_ || length_t < least_base_ || std::abs(length_s - length_t) > stretch_) return false;
    const Eigen::Vector3f &ns_a = s.normals[a.source], &ns_b = s.normals[b.source], &nt_a = t.normals[a.target],
                          &nt_b = t.normals[b.target];
    return angle_between(ns_a.dot(ns_b), nt_a.dot(nt_b)) < kMostAngle &&
           angle_between(ns_a.dot(base_s) / length_s, nt_a.dot(base_t) / length_t) < kMostAngle &&
           angle_between(ns_b.dot(base_s) / length_s, nt_b.dot(base_t) / length_t) < kMostAngle;
  }

  [[nodiscard]] bool move(const Correspondence& a, const Correspondence& b, Draw& draw) const {
    const auto& s = source_.means();
    const auto& t = target_.means();
    Eigen::Matrix3f from, to;
    if (!frame_of(s.points[b.source] - s.points[a.source], s.normals[a.source] + s.normals[b.source], from) ||
        !frame_of(t.points[b.target] - t.points[a.target], t.normals[a.target] + t.normals[b.target], to))
      return false;
    draw.turn = to * from.transpose();
    if ((draw.turn * s.normals[a.source]).dot(t.normals[a.target]) < kFacesAlike ||
        (draw.turn * s.normals[b.source]).dot(t.normals[b.target]) < kFacesAlike)
      return false;
    draw.shift =
        (t.points[a.target] + t.points[b.target]) / 2 - draw.turn * ((s.points[a.source] + s.points[b.source]) / 2);
    return true;
  }

  const CoarseShape& source_;
  const CoarseShape& target_;
  std::vector<Correspondence> pairs_;
  float least_base_ = 0, stretch_ = 0;
};

RigidMotion motion_of(const Draw& draw) {
  RigidMotion motion = RigidMotion::Identity();
  motion.linear() = Eigen::Quaterniond{draw.turn.cast<double>()}.normalized().toRotationMatrix();
  motion.translation() = draw.shift.cast<double>();
  return motion;
}

}  // namespace

OrientedPoints cell_means(const OrientedPoints& from, double cell) {
  std::vector<std::tuple<std::int64_t, std::int64_t, std::int64_t, std::uint32_t>> order;
  order.reserve(from.points.size());
  const auto index = [&](float c) { return static_cast<std::int64_t>(std::floor(static_cast<double>(c) / cell)); };
  for (std::uint32_t i = 0; i < from.points.size(); ++i) {
    const Eigen::Vector3f& p = from.points[i];
    order.emplace_back(index(p.x()), index(p.y()), index(p.z()), i);
  }
  std::sort(order.begin(), order.end());
  OrientedPoints means;
  for (std::size_t begin = 0; begin < order.size();) {
    const auto same = [&](std::size_t k) {
      return std::get<0>(order[k]) == std::get<0>(order[begin]) && std::get<1>(order[k]) == std::get<1>(order[begin]) &&
             std::get<2>(order[k]) == std::get<2>(order[begin]);
    };
    std::size_t end = begin;
    Vec3 point = Vec3::Zero(), normal = Vec3::Zero();
    for (; end < order.size() && same(end); ++end) {
      point += from.points[std::get<3>(order[end])].cast<double>();
      normal += from.normals[std::get<3>(order[end])].cast<double>();
    }
    const auto count = static_cast<double>(end - begin);
    if (normal.norm() > kLeastMeanNormal * count) {
      means.points.push_back((point / count).cast<float>());
      means.normals.push_back(normal.normalized().cast<float>());
    }
    begin = end;
  }
  return means;
}

CoarseShape::CoarseShape(const OrientedPoints& from, double cell) : means_{cell_means(from, cell)}, cell_{cell} {
  if (means_.points.empty()) return;
  leave_out_strays(means_);
  Eigen::Vector3f low = means_.points[0], high = low;
  for (const Eigen::Vector3f& p : means_.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  diagonal_ = static_cast<double>((high - low).norm());
  middle_ = ((low + high) / 2).cast<double>();
  const KdTree tree{means_.points};
  descriptors_ = describe_points(means_.points, means_.normals, tree, kDescriptorRadius * static_cast<float>(cell));

  // A shape much larger than the others must not take all the memory.
  constexpr double kMostCubes = 2e7;
  const Vec3 extent = (high - low).cast<double>().array() + 2 * (kReach + 1) * cell;
  grid_ = static_cast<float>(std::max(cell, std::cbrt(extent.prod() / kMostCubes)));
  const float side = grid_, within = kReach * std::max(side, static_cast<float>(cell));
  low_ = low.array() - (kReach + 0.5F) * side;
  size_ = ((high - low_) / side).array().floor().cast<int>() + kReach + 2;
  nearest_.assign(static_cast<std::size_t>(size_.prod()), -1);
  tbb::parallel_for(0, size_.z(), [&](int z) {
    for (int y = 0; y < size_.y(); ++y)
      for (int x = 0; x < size_.x(); ++x) {
        const Eigen::Vector3f at =
            low_ +
            (Eigen::Array3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)) + 0.5F).matrix() *
                side;
        const Neighbour n = tree.nearest(at);
        if (n.squared_distance < within * within)
          nearest_[static_cast<std::size_t>((z * size_.y() + y) * size_.x() + x)] = static_cast<std::int32_t>(n.index);
      }
  });
}

std::int32_t CoarseShape::near(const Eigen::Vector3f& place) const {
  const Eigen::Array3f at = (place - low_).array() / grid_;
  if (!(at >= 0).all() || !(at < size_.cast<float>()).all()) return -1;
  const Eigen::Array3i cube = at.cast<int>();
  return nearest_[static_cast<std::size_t>((cube.z() * size_.y() + cube.y()) * size_.x() + cube.x())];
}

std::vector<CoarsePose> search_poses(const CoarseShape& source, const CoarseShape& target, const CoarseOptions& options,
                                     const std::stop_token& stop) {
  if (source.means().points.size() < kLeastMeans || target.means().points.size() < kLeastMeans) return {};
  std::vector<Correspondence> pairs = correspondences(source, target);
  if (pairs.size() < 3) return {};
  const Consensus consensus{source, target, std::move(pairs)};
  const std::uint32_t blocks = (options.draws + kBlock - 1) / kBlock;
  std::vector<std::vector<Draw>> drawn(blocks);
  tbb::parallel_for(std::uint32_t{0}, blocks, [&](std::uint32_t b) {
    if (stop.stop_requested()) return;
    std::seed_seq mixed{options.seed & 0xFFFFFFFFU, options.seed >> 32U, std::uint64_t{b}};
    std::array<std::uint32_t, 2> seed{};
    mixed.generate(seed.begin(), seed.end());
    drawn[b] = consensus.block((std::uint64_t{seed[0]} << 32U) | seed[1], std::min(kBlock, options.draws - b * kBlock));
  });
  std::vector<Draw> all;
  for (const auto& block : drawn) all.insert(all.end(), block.begin(), block.end());
  std::stable_sort(all.begin(), all.end(), [](const Draw& l, const Draw& r) { return l.share > r.share; });
  std::vector<CoarsePose> poses;
  for (const Draw& draw : all) {
    if (poses.size() >= options.most || draw.share < all.front().share / 2) break;
    const RigidMotion motion = motion_of(draw);
    const bool is_new = std::ranges::none_of(poses, [&](const CoarsePose& p) {
      const MotionDifference d = difference(p.motion, motion, source.middle());
      return d.degrees < kSameTurnDeg && d.shift < kSameShiftCells * source.cell();
    });
    if (is_new) poses.push_back({motion, static_cast<double>(draw.share)});
  }
  return poses;
}

}  // namespace telefab::scan
