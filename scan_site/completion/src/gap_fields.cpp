// SPDX-License-Identifier: GPL-3.0-or-later
#include "gap_fields.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/base/disjoint_sets.hpp>
#include <telefab/scan/cloud/box3.hpp>

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

/// Rims nearer than so many spacings belong to one loop.
constexpr float kLoopSpacings = 3;
/// A loop of fewer rims, or of less extent in spacings, bounds a gap that any continuation closes alike.
constexpr std::size_t kLeastRims = 8;
constexpr float kLeastExtent = 6;
/// Two loops bound one gap where they are nearer than this part of the smaller one,
constexpr float kBesideShare = 0.5F;
/// or look at each other (cosine to the way there) across less than so many times the smaller one;
constexpr float kLooks = 0.7F;
constexpr float kAcross = 3;
/// and nothing was measured within this part of the distance of the middle between them.
constexpr float kClearShare = 0.35F;
/// So many rims of each are compared, at most.
constexpr std::size_t kCompared = 96;
/// The belt reaches so far from the rims, in extents of the gap; its places are at least so far apart at the rims, and
/// farther with the distance from them; so many of them for each of at most two loops.
constexpr float kBelt = 0.6F;
constexpr float kApart = 0.06F;
constexpr float kApartSpacings = 1.5F;
constexpr float kApartGrowth = 0.25F;
constexpr std::size_t kMostPlaces = 90;
/// Normals that agree by less belong to another side, which has places of its own.
constexpr float kSameSide = 0.3F;
/// Rims from which the belt is gathered.
constexpr std::size_t kGathered = 64;
/// Of the samples that a function was not given nine of ten lie nearer to its zero set than this, in distances between
/// those given, and have its normals to within this cosine.
constexpr std::size_t kLeastForetold = 20;
constexpr float kMostOff = 0.06F;
constexpr float kLeastTurned = 0.96F;
/// No place of a closed gap is farther from the samples than this part of its extent, or than it is wide.
constexpr float kFarthest = 0.5F;

/// Members of each set, sets and members in rising order.
std::vector<std::vector<std::uint32_t>> members_of(DisjointSets& sets) {
  std::vector<std::vector<std::uint32_t>> members;
  const std::vector<std::uint32_t> numbers = sets.numbers();
  for (std::uint32_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] == members.size()) members.emplace_back();
    members[numbers[i]].push_back(i);
  }
  return members;
}

struct Loop {
  std::vector<std::uint32_t> rims;
  Box3 box;
  float extent = 0;
};

std::vector<Loop> loops_of(const MeasuredSide& measured, std::span<const Rim> rims, std::span<const Vector3f> places) {
  const KdTree near{places};
  DisjointSets sets{rims.size()};
  for (std::uint32_t i = 0; i < rims.size(); ++i)
    for (const Neighbour& n : near.within(places[i], kLoopSpacings * measured.spacings[rims[i].sample]))
      sets.join(i, n.index);
  std::vector<Loop> loops;
  for (auto& members : members_of(sets)) {
    Box3 box = Box3::nothing();
    for (const std::uint32_t i : members) box.include(places[i].cast<double>());
    const auto extent = static_cast<float>(box.size().norm());
    if (members.size() >= kLeastRims && extent >= kLeastExtent * measured.spacings[rims[members[0]].sample])
      loops.push_back({std::move(members), box, extent});
  }
  return loops;
}

/// How far apart two loops are that bound one gap; none where they do not.
std::optional<float> across_gap(const MeasuredSide& measured, std::span<const Rim> rims, const Loop& a, const Loop& b) {
  const float smaller = std::min(a.extent, b.extent);
  const Vec3 between = (a.box.min - b.box.max).cwiseMax(b.box.min - a.box.max).cwiseMax(0);
  if (between.norm() > kAcross * smaller) return std::nullopt;
  std::optional<float> least;
  for (std::size_t i = 0; i < a.rims.size(); i += 1 + a.rims.size() / kCompared)
    for (std::size_t j = 0; j < b.rims.size(); j += 1 + b.rims.size() / kCompared) {
      const Rim &p = rims[a.rims[i]], &q = rims[b.rims[j]];
      const Vector3f from = measured.points[p.sample], way = measured.points[q.sample] - from;
      const float distance = way.norm();
      if (distance > kAcross * smaller || (least && distance >= *least)) continue;
      if (distance >= kBesideShare * smaller && ((p.probe - from).normalized().dot(way) < kLooks * distance ||
                                                 (q.probe - from - way).normalized().dot(-way) < kLooks * distance))
        continue;
      const float clear = kClearShare * distance;
      if (measured.near.nearest(from + way / 2).squared_distance >= clear * clear) least = distance;
    }
  return least;
}

struct Belt {
  std::vector<Vector3f> places, normals;
  std::vector<std::uint32_t> left_out;  ///< samples between them,
  std::vector<float> apart;             ///< and how far apart the places are there
};

/// Samples about the rims, denser near them.
Belt belt_about(const MeasuredSide& measured, std::span<const Vector3f> rims, float extent, std::size_t most) {
  std::vector<std::uint32_t> about;
  for (std::size_t k = 0; k < rims.size(); k += 1 + rims.size() / kGathered)
    for (const Neighbour& n : measured.near.within(rims[k], kBelt * extent)) about.push_back(n.index);
  std::sort(about.begin(), about.end());
  about.erase(std::unique(about.begin(), about.end()), about.end());
  const KdTree near{rims};
  std::vector<Neighbour> by_distance;
  for (const std::uint32_t i : about) by_distance.push_back({i, near.nearest(measured.points[i]).squared_distance});
  std::stable_sort(by_distance.begin(), by_distance.end(),
                   [](const Neighbour& a, const Neighbour& b) { return a.squared_distance < b.squared_distance; });
  for (float wanted = kApart * extent;; wanted *= 1.25F) {
    Belt belt;
    for (const Neighbour& n : by_distance) {
      const Vector3f &p = measured.points[n.index], &normal = measured.normals[n.index];
      const float apart =
          std::max(wanted, kApartSpacings * measured.spacings[n.index]) + kApartGrowth * std::sqrt(n.squared_distance);
      bool is_near = false;
      for (std::size_t k = 0; k < belt.places.size() && !is_near; ++k)
        is_near = (belt.places[k] - p).squaredNorm() < apart * apart && belt.normals[k].dot(normal) > kSameSide;
      if (is_near) {
        belt.left_out.push_back(n.index);
        belt.apart.push_back(apart);
        continue;
      }
      belt.places.push_back(p);
      belt.normals.push_back(normal);
      if (belt.places.size() > most) break;
    }
    if (belt.places.size() <= most) return belt;
  }
}

float nth(std::vector<float>& values, double share) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Whether the function knows of the samples that it was not given. Across edges, details and noise it does not, and
/// knows as little of what lies in the gap.
bool foretells(const HermiteField& field, const Belt& belt, const MeasuredSide& measured) {
  if (belt.left_out.size() < kLeastForetold) return false;
  std::vector<float> off, turned;
  for (std::size_t k = 0; k < belt.left_out.size(); ++k) {
    const HermiteField::Value at = field.at(measured.points[belt.left_out[k]]);
    off.push_back(std::abs(at.value) / belt.apart[k]);
    turned.push_back(at.gradient.normalized().dot(measured.normals[belt.left_out[k]]));
  }
  return nth(off, 0.9) < kMostOff && nth(turned, 0.1) > kLeastTurned;
}

std::optional<HermiteField> through_half(const Belt& belt, std::size_t first) {
  std::vector<Vector3f> places, normals;
  for (std::size_t k = first; k < belt.places.size(); k += 2) {
    places.push_back(belt.places[k]);
    normals.push_back(belt.normals[k]);
  }
  return HermiteField::through(places, normals);
}

}  // namespace

Result<GapFields> GapFields::about(const MeasuredSide& measured, std::span<const Rim> rims, std::stop_token stop) {
  GapFields fields;
  fields.rims_.assign(rims.begin(), rims.end());
  for (const Rim& rim : rims) fields.places_.push_back(measured.points[rim.sample]);
  fields.gap_of_rim_.assign(rims.size(), -1);
  const std::vector<Loop> loops = loops_of(measured, rims, fields.places_);
  DisjointSets joined{loops.size()};
  std::vector<float> across(loops.size(), 0);
  for (std::uint32_t a = 0; a < loops.size(); ++a)
    for (std::uint32_t b = a + 1; b < loops.size(); ++b) {
      if (stop.stop_requested()) return cancelled("closing gaps of the scan");
      if (const auto apart = across_gap(measured, rims, loops[a], loops[b])) {
        joined.join(a, b);
        across[a] = std::max(across[a], *apart);
      }
    }
  const auto groups = members_of(joined);
  fields.gaps_.resize(groups.size());
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
    if (stop.stop_requested()) return;
    std::vector<Vector3f> own;
    float extent = 0, widest = 0;
    for (const std::uint32_t l : groups[g]) {
      extent = std::max(extent, loops[l].extent);
      widest = std::max(widest, across[l]);
      for (const std::uint32_t i : loops[l].rims) {
        own.push_back(fields.places_[i]);
        fields.gap_of_rim_[i] = static_cast<std::int32_t>(g);
      }
    }
    const Belt belt = belt_about(measured, own, extent, kMostPlaces * std::min<std::size_t>(2, groups[g].size()));
    Gap& gap = fields.gaps_[g];
    gap.farthest = std::max(kFarthest * extent, widest);
    gap.field = HermiteField::through(belt.places, belt.normals);
    if (gap.field && !foretells(*gap.field, belt, measured)) gap.field.reset();
    if (gap.field) gap.halves = {through_half(belt, 0), through_half(belt, 1)};
  });
  if (stop.stop_requested()) return cancelled("closing gaps of the scan");
  fields.index_rims();
  return fields;
}

void GapFields::index_rims() {
  gap_of_near_.clear();
  std::vector<Vector3f> places;
  for (std::size_t i = 0; i < rims_.size(); ++i)
    if (has_function(i)) {
      gap_of_near_.push_back(gap_of_rim_[i]);
      places.push_back(places_[i]);
    }
  near_ = std::make_unique<KdTree>(places);
}

std::vector<Rim> GapFields::rims(bool with_function) const {
  std::vector<Rim> found;
  for (std::size_t i = 0; i < rims_.size(); ++i)
    if (has_function(i) == with_function) found.push_back(rims_[i]);
  return found;
}

std::size_t GapFields::gap_at(const Vector3f& place) const {
  return static_cast<std::size_t>(gap_of_near_[near_->nearest(place).index]);
}

float GapFields::opinions(std::size_t gap, const Vector3f& place) const {
  float most = 0;
  for (const auto& half : gaps_[gap].halves) {
    if (!half) return farthest(gap);
    const HermiteField::Value at = half->at(place);
    most = std::max(most, std::abs(at.value) / at.slope());
  }
  return most;
}

void GapFields::drop(const std::vector<bool>& gaps) {
  for (std::size_t g = 0; g < gaps.size(); ++g)
    if (gaps[g]) gaps_[g].field.reset();
  index_rims();
}

}  // namespace telefab::scan
