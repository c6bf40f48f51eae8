// SPDX-License-Identifier: GPL-3.0-or-later
#include "relax.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

/// Kernel: so many spacings, or this part of the gap.
constexpr float kLeastSpacings = 1.5F;
constexpr float kGapShare = 0.5F;
/// Samples farther than this many kernels are not asked: they weigh less than a thousandth.
constexpr float kReach = 2.6F;
/// Normals that agree by less lie on the other side of a wall.
constexpr float kLeastAgreement = -0.2F;

/// Who moves whom: found once, samples move by parts of a spacing only.
struct Neighbours {
  std::vector<std::uint32_t> measured;
  std::vector<std::uint32_t> virtuals;
};

struct Sums {
  double weight = 0;
  double plane = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();

  void add(const VirtualSample& at, const Vector3f& point, const Vector3f& n, float area, float kernel) {
    if (n.dot(at.normal) < kLeastAgreement) return;
    const Vector3f d = point - at.point;
    const double theta =
        static_cast<double>(area) * std::exp(-static_cast<double>(d.squaredNorm() / (kernel * kernel)));
    weight += theta;
    plane -= theta * static_cast<double>(d.dot(n));
    normal += theta * n.cast<double>();
    offset += theta * d.cast<double>();
  }
};

VirtualSample relaxed(const VirtualSample& sample, const Sums& sums) {
  const double length = sums.normal.norm();
  if (!(sums.weight > 0) || !(length > 1e-6 * sums.weight)) return sample;
  VirtualSample moved = sample;
  const Eigen::Vector3d n = sums.normal / length;
  const double value = (sums.plane / sums.weight - sums.offset.dot(n) / sums.weight) / 2;
  moved.point = (sample.point.cast<double>() - value * n).cast<float>();
  moved.normal = n.cast<float>();
  return moved;
}

}  // namespace

Result<void> relax(const MeasuredSide& measured, std::vector<VirtualSample>& samples, int rounds,
                   std::stop_token stop) {
  if (rounds == 0 || samples.empty()) return {};
  std::vector<Vector3f> places;
  places.reserve(samples.size());
  for (const VirtualSample& s : samples) places.push_back(s.point);
  const KdTree near{places};
  std::vector<float> kernel(samples.size());
  std::vector<Neighbours> neighbours(samples.size());
  const auto each = [&](auto&& one) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, samples.size(), 128}, [&](const auto& range) {
      if (stop.stop_requested()) return;
      for (std::size_t i = range.begin(); i < range.end(); ++i) one(i);
    });
  };
  each([&](std::size_t i) {
    if (samples[i].smooth) return;
    kernel[i] = std::max(kLeastSpacings * samples[i].spacing, kGapShare * samples[i].gap);
    for (const Neighbour& n : measured.near.within(places[i], kReach * kernel[i]))
      neighbours[i].measured.push_back(n.index);
    for (const Neighbour& n : near.within(places[i], kReach * kernel[i]))
      if (n.index != i) neighbours[i].virtuals.push_back(n.index);
  });
  std::vector<VirtualSample> next(samples.size());
  for (int round = 0; round < rounds; ++round) {
    each([&](std::size_t i) {
      if (samples[i].smooth) {
        next[i] = samples[i];
        return;
      }
      Sums sums;
      for (const std::uint32_t k : neighbours[i].measured)
        sums.add(samples[i], measured.points[k], measured.normals[k], measured.areas[k], kernel[i]);
      for (const std::uint32_t k : neighbours[i].virtuals)
        sums.add(samples[i], samples[k].point, samples[k].normal, samples[k].spacing * samples[k].spacing, kernel[i]);
      next[i] = relaxed(samples[i], sums);
    });
    if (stop.stop_requested()) return cancelled("closing gaps of the scan");
    samples.swap(next);
  }
  each([&](std::size_t i) { samples[i].gap = std::sqrt(measured.near.nearest(samples[i].point).squared_distance); });
  return {};
}

}  // namespace telefab::scan
