// SPDX-License-Identifier: GPL-3.0-or-later
#include <Eigen/Geometry>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <telefab/scan/completion/facing.hpp>

namespace telefab::scan {
namespace {

/// Cosine between a normal and the way to the other sample from which on it looks there: 45 degrees.
constexpr float kLooks = 0.7F;

/// The air between is looked at beside the middle, these parts of the distance away, in eight directions;
constexpr std::array kAside{0.55F, 0.8F};
/// it is open where so many are air.
constexpr int kMostOpen = 5;

bool all_air(const WindingTree& all, const Eigen::Vector3f& from, const Eigen::Vector3f& way) {
  constexpr std::array kShares{0.5F, 0.25F, 0.75F};
  return std::all_of(kShares.begin(), kShares.end(),
                     [&](float share) { return all.winding(from + share * way) < 0.5F; });
}

/// Whether the air between two places lies open on most sides. In a hollow whose walls nobody scanned it does not:
/// they face each other too, and may as little be one as the walls of any other hollow.
bool is_open(const WindingTree& all, const Eigen::Vector3f& from, const Eigen::Vector3f& way) {
  const Eigen::Vector3f u = way.unitOrthogonal(), v = way.normalized().cross(u);
  int open = 0;
  for (const float x : {-1.F, 0.F, 1.F})
    for (const float y : {-1.F, 0.F, 1.F}) {
      if (x == 0 && y == 0) continue;
      const Eigen::Vector3f side = (x * u + y * v).normalized();
      open += std::all_of(kAside.begin(), kAside.end(), [&](float aside) {
        return all.winding(from + 0.5F * way + aside * way.norm() * side) < 0.5F;
      });
    }
  return open >= kMostOpen;
}

std::optional<std::uint32_t> faced_by(std::span<const VirtualSample> samples, const KdTree& near,
                                      const WindingTree& all, std::size_t i, float widest, float most_gaps) {
  const VirtualSample& a = samples[i];
  float least = most_gaps;
  std::optional<std::uint32_t> found;
  for (const Neighbour& n : near.within(a.point, most_gaps * (a.gap + widest))) {
    const VirtualSample& b = samples[n.index];
    const Eigen::Vector3f way = b.point - a.point;
    const float distance = way.norm();
    const float gaps = distance / (a.gap + b.gap);
    // The smoothest function knew of both and parted them.
    if (n.index == i || (a.smooth && b.smooth) || gaps >= least || a.normal.dot(way) < kLooks * distance ||
        -b.normal.dot(way) < kLooks * distance)
      continue;
    if (!all_air(all, a.point, way) || !is_open(all, a.point, way)) continue;
    least = gaps;
    found = n.index;
  }
  return found;
}

}  // namespace

std::vector<FacingPair> facing_pairs(std::span<const VirtualSample> samples, const WindingTree& all, float most_gaps) {
  if (samples.empty()) return {};
  std::vector<Eigen::Vector3f> places;
  float widest = 0;
  for (const VirtualSample& s : samples) {
    places.push_back(s.point);
    widest = std::max(widest, s.gap);
  }
  const KdTree near{places};
  std::vector<std::optional<std::uint32_t>> faced(samples.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, samples.size(), 64}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i)
      faced[i] = faced_by(samples, near, all, i, widest, most_gaps);
  });
  std::vector<FacingPair> pairs;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (faced[i]) pairs.push_back({places[i], places[*faced[i]]});
  return pairs;
}

}  // namespace telefab::scan
