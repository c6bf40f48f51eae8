// SPDX-License-Identifier: GPL-3.0-or-later
#include "rims.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

constexpr std::size_t kAreaNeighbours = 10;
constexpr std::size_t kLeastIsland = 4;
/// The third neighbour is a spacing away; more than so many times its distance the spacing is not.
constexpr float kThirdSpacings = 1.3F;
constexpr std::size_t kRimNeighbours = 16;
/// Among so many the neighbours on the same side of a thin wall are looked for.
constexpr std::size_t kLookedAt = 28;
/// A sample in the middle of its neighbours leans by less, one at a straight rim by .42.
constexpr float kLeastLean = 0.12F;
constexpr float kLeanRange = 0.30F;
/// Normals that agree by less belong to another face; so far from a sample, and so deep below its plane, in spacings,
/// it is the face beyond an edge and not the other side of a wall.
constexpr float kFaceCos = 0.5F;
constexpr float kEdgeSpacings = 2;
constexpr float kEdgeDepth = 1;
/// A sector of the tangent plane this wide without a neighbour is a gap.
constexpr float kLeastSector = std::numbers::pi_v<float> / 2;

/// The widest sector between neighbours: its middle direction and width; none where there are too few neighbours.
struct Sector {
  Vector3f middle = Vector3f::Zero();
  float width = 0;
};
Sector widest_sector(std::span<const Vector3f> offsets, const Vector3f& normal) {
  const Vector3f u = normal.unitOrthogonal();
  const Vector3f v = normal.cross(u);
  std::array<float, kRimNeighbours> angles{};
  std::size_t count = 0;
  for (const Vector3f& d : offsets) {
    const float x = d.dot(u), y = d.dot(v);
    if (x != 0 || y != 0) angles[count++] = std::atan2(y, x);
  }
  if (count == 0) return {};
  std::sort(angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(count));
  Sector widest;
  for (std::size_t i = 0; i < count; ++i) {
    const float next = i + 1 < count ? angles[i + 1] : angles[0] + 2 * std::numbers::pi_v<float>;
    if (next - angles[i] <= widest.width) continue;
    widest.width = next - angles[i];
    const float middle = (angles[i] + next) / 2;
    widest.middle = std::cos(middle) * u + std::sin(middle) * v;
  }
  return widest;
}

/// Whether a sector may be as wide as a gap, among so few neighbours that others can only narrow it: none is where each
/// has another within a quarter turn to its left.
bool may_have_gap(std::span<const Vector3f> offsets, const Vector3f& normal) {
  /// As sine and cosine: a sector nearer to a quarter turn than this is measured.
  constexpr float kSlack = 1e-4F;
  const Vector3f u = normal.unitOrthogonal();
  const Vector3f v = normal.cross(u);
  std::array<float, kAreaNeighbours> x{}, y{};
  std::size_t count = 0;
  for (const Vector3f& d : offsets) {
    const float dx = d.dot(u), dy = d.dot(v), length = std::sqrt(dx * dx + dy * dy);
    if (!(length > 0)) continue;
    x[count] = dx / length;
    y[count++] = dy / length;
  }
  for (std::size_t i = 0; i < count; ++i) {
    bool has_next = false;
    for (std::size_t j = 0; j < count; ++j)
      has_next |= x[i] * x[j] + y[i] * y[j] > kSlack && x[i] * y[j] - y[i] * x[j] > kSlack;
    if (!has_next) return true;
  }
  return count == 0;
}

/// Whether the surface turns over an edge there instead of ending: a sample of another face lies beside, not below.
bool turns_over(const Vector3f& offset, const Vector3f& own, const Vector3f& other, const Vector3f& way,
                float spacing) {
  return own.dot(other) < kFaceCos && offset.dot(way) > 0 && offset.norm() < kEdgeSpacings * spacing &&
         std::abs(offset.dot(own)) < kEdgeDepth * spacing;
}

/// How many of the found neighbours belong to the same island: where the distance doubles from one to the next, the
/// far ones lie across a gap and tell nothing of the spacing here.
std::size_t island_of(std::span<const Neighbour> found) {
  for (std::size_t k = kLeastIsland; k < found.size(); ++k)
    if (found[k].squared_distance > 4 * found[k - 1].squared_distance && found[k - 1].squared_distance > 0) return k;
  return found.size();
}

/// A sample among its nearest neighbours, itself the first.
struct Island {
  Island(const KdTree& near, std::span<const Vector3f> points, std::span<const Vector3f> normals, std::uint32_t i)
      : count{island_of({found.data(), near.nearest(points[i], found)})} {
    const auto others = static_cast<float>(std::max<std::size_t>(1, count - 1));
    Vector3f offset = Vector3f::Zero();
    for (std::size_t k = 0; k < count; ++k) offset += points[found[k].index] - points[i];
    offset /= others;
    offset -= offset.dot(normals[i]) * normals[i];
    const float reach2 = found[count - 1].squared_distance;
    lean = reach2 > 0 ? offset.norm() / std::sqrt(reach2) : 0;
    const float missing = std::clamp((lean - kLeastLean) / kLeanRange, 0.F, 1.F) / 2;
    area = std::numbers::pi_v<float> * reach2 / others * (1 - missing);
  }
  std::array<Neighbour, kAreaNeighbours + 1> found;
  std::size_t count;  ///< of them
  float lean;         ///< how far they lie to one side: their mean offset over their reach
  float area;         ///< as of Surroundings
};

template <class Each>
void each_in_leaf_order(const KdTree& near, const std::stop_token& stop, Each&& each) {
  const auto order = near.leaf_order();
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, order.size(), 1024}, [&](const auto& range) {
    if (stop.stop_requested()) return;
    for (std::size_t i = range.begin(); i < range.end(); ++i) each(order[i]);
  });
}

}  // namespace

RimReach RimReach::at_noise(double noise_spacings) {
  const auto rough = static_cast<float>(std::clamp((noise_spacings - 0.05) / 0.1, 0.0, 1.0));
  return {1.4F + 0.4F * rough, 1.8F + 0.4F * rough};
}

float Surroundings::median_spacing() const {
  std::vector<float> values = spacing;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

float area_of(const KdTree& near, std::span<const Vector3f> points, std::span<const Vector3f> normals,
              std::uint32_t sample) {
  return Island{near, points, normals, sample}.area;
}

Result<Surroundings> look_around(const KdTree& near, std::span<const Vector3f> points,
                                 std::span<const Vector3f> normals, std::stop_token stop) {
  Surroundings around;
  around.area.resize(points.size());
  around.may_be_rim.resize(points.size());
  around.spacing.resize(points.size());
  std::vector<std::array<std::uint32_t, kAreaNeighbours + 1>> neighbours(points.size());
  std::vector<float> third(points.size());  // distance of the third neighbour
  each_in_leaf_order(near, stop, [&](std::uint32_t i) {
    const Island island{near, points, normals, i};
    for (std::size_t k = 0; k < island.found.size(); ++k) neighbours[i][k] = island.found[k % island.count].index;
    third[i] = std::sqrt(island.found[std::min<std::size_t>(3, island.count - 1)].squared_distance);
    around.area[i] = island.area;
    if (island.lean < kLeastLean) return;
    std::array<Vector3f, kAreaNeighbours> offsets;
    std::size_t used = 0;
    for (const Neighbour& n : island.found)
      if (used < offsets.size() && n.index != i && normals[n.index].dot(normals[i]) > 0)
        offsets[used++] = points[n.index] - points[i];
    around.may_be_rim[i] = may_have_gap({offsets.data(), used}, normals[i]) ? 1 : 0;
  });
  each_in_leaf_order(near, stop, [&](std::uint32_t i) {
    float sum = 0;
    std::array<float, kAreaNeighbours + 1> near_ones;
    for (std::size_t k = 0; k < near_ones.size(); ++k) {
      sum += around.area[neighbours[i][k]];
      near_ones[k] = third[neighbours[i][k]];
    }
    std::nth_element(near_ones.begin(), near_ones.begin() + near_ones.size() / 2, near_ones.end());
    // The disc of a few samples in the middle of a gap is mostly gap.
    around.spacing[i] = std::min(std::sqrt(sum / static_cast<float>(near_ones.size())),
                                 kThirdSpacings * near_ones[near_ones.size() / 2]);
  });
  if (stop.stop_requested()) return cancelled("looking for gaps of the scan");
  return around;
}

Result<std::vector<Rim>> find_rims(const KdTree& near, std::span<const Vector3f> points,
                                   std::span<const Vector3f> normals, const Surroundings& around, const RimReach& reach,
                                   std::stop_token stop) {
  std::vector<std::uint8_t> is_rim(points.size(), 0);
  std::vector<Vector3f> probes(points.size());
  each_in_leaf_order(near, stop, [&](std::uint32_t i) {
    if (around.may_be_rim[i] == 0) return;
    std::array<Neighbour, kLookedAt> found;
    const std::size_t count = near.nearest(points[i], found);
    std::array<Vector3f, kRimNeighbours> offsets;
    std::size_t used = 0;
    for (std::size_t k = 0; k < count && used < kRimNeighbours; ++k)
      if (found[k].index != i && normals[found[k].index].dot(normals[i]) > 0)
        offsets[used++] = points[found[k].index] - points[i];
    const Sector sector = widest_sector({offsets.data(), used}, normals[i]);
    if (sector.width < kLeastSector) return;
    const float spacing = around.spacing[i];
    for (std::size_t k = 0; k < count; ++k)
      if (turns_over(points[found[k].index] - points[i], normals[i], normals[found[k].index], sector.middle, spacing))
        return;
    const Vector3f probe = points[i] + reach.probe * spacing * sector.middle;
    const float covered = reach.covered * spacing;
    if (near.nearest(probe).squared_distance < covered * covered) return;
    is_rim[i] = 1;
    probes[i] = probe;
  });
  if (stop.stop_requested()) return cancelled("looking for gaps of the scan");
  std::vector<Rim> rims;
  for (std::uint32_t i = 0; i < points.size(); ++i)
    if (is_rim[i]) rims.push_back({i, probes[i]});
  return rims;
}

}  // namespace telefab::scan
