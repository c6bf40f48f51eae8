// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/two_sheets.hpp>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <telefab/base/median.hpp>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <vector>

namespace telefab::scan {
namespace {

constexpr std::size_t kAsked = 2000;  ///< places at first
/// A place: its nearest points, and how far apart the heaps must at least be, in spacings. Sheets far from each other
/// need a wide one, on which a surface may curve more.
struct Patch {
  std::size_t points;
  float least_apart;
};
constexpr std::array kPatches{Patch{40, 0.7F}, Patch{120, 1.4F}};
constexpr std::size_t kMostPoints = kPatches.back().points;
constexpr float kSame = 0.5F;       ///< share of the points of a place that must look the same way
constexpr std::size_t kAround = 8;  ///< places about one that must say the same
constexpr float kSameSide = 0.7F;   ///< cosine between normals of one surface
/// Of the distances' variance, what lies between two heaps: 0.64 of a normal distribution, 0.75 of an even one.
constexpr float kBetween = 0.8F;
constexpr float kKurtosis = 2;  ///< of the distances: 3 of a normal distribution, 1.8 of an even one, 1 of two values
constexpr float kApartAside = 0.5F;  ///< between the heaps along the surface, radii of the place: a step has them apart
constexpr float kLeastHeap = 0.15F;  ///< share of the points in the smaller heap
constexpr double kLeastConfirmed = 0.005;  ///< of the places asked first
constexpr std::size_t kFewConfirmed = 4;

/// A place looked at: how its points lie about a smooth surface through them.
struct Look {
  float apart = 0;  ///< between the means of the two heaps
  float between = 0;
  float kurtosis = 3;
  float spacing = 0;
};

using Row = Eigen::Matrix<float, 6, 1>;

/// Nothing where too few points look the same way, or the heaps lie side by side.
std::optional<Look> look_at(const PointCloud& cloud, const KdTree& tree, std::uint32_t place, const Patch& patch) {
  std::array<Neighbour, kMostPoints> nearest;
  const std::span<Neighbour> near = std::span{nearest}.first(patch.points);
  if (tree.nearest(cloud.points[place], near) < near.size()) return std::nullopt;
  const Eigen::Vector3f at = cloud.points[place], normal = cloud.normals[place];
  const Eigen::Vector3f u = normal.unitOrthogonal(), v = normal.cross(u);
  Look look;
  const float radius = std::sqrt(near.back().squared_distance);
  if (!(radius > 0)) return std::nullopt;
  look.spacing = radius * std::sqrt(std::numbers::pi_v<float> / static_cast<float>(near.size()));
  std::array<std::array<float, 3>, kMostPoints> local;  // in radii
  std::size_t count = 0;
  Eigen::Matrix<float, 6, 6> square = Eigen::Matrix<float, 6, 6>::Zero();
  Row right = Row::Zero();
  const auto row_of = [](const std::array<float, 3>& p) {
    return Row{{1, p[0], p[1], p[0] * p[0], p[0] * p[1], p[1] * p[1]}};
  };
  for (const Neighbour& n : near) {
    if (cloud.normals[n.index].dot(normal) < kSameSide) continue;
    const Eigen::Vector3f d = (cloud.points[n.index] - at) / radius;
    local[count] = {d.dot(u), d.dot(v), d.dot(normal)};
    const Row row = row_of(local[count]);
    square += row * row.transpose();
    right += local[count][2] * row;
    ++count;
  }
  if (static_cast<float>(count) < kSame * static_cast<float>(near.size())) return std::nullopt;
  square.diagonal().array() += 1e-4F;
  const Row fit = square.ldlt().solve(right);
  if (!fit.allFinite()) return std::nullopt;
  std::array<std::pair<float, std::size_t>, kMostPoints> off;
  float mean = 0;
  for (std::size_t i = 0; i < count; ++i) {
    off[i] = {local[i][2] - fit.dot(row_of(local[i])), i};
    mean += off[i].first / static_cast<float>(count);
  }
  float second = 0, fourth = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const float d2 = (off[i].first - mean) * (off[i].first - mean);
    second += d2 / static_cast<float>(count);
    fourth += d2 * d2 / static_cast<float>(count);
  }
  if (!(second > 0)) return std::nullopt;
  look.kurtosis = fourth / (second * second);
  // Otsu's threshold: the two heaps that leave most of the variance between them.
  std::sort(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(count));
  float low = 0, all = mean * static_cast<float>(count);
  std::size_t best = 0;
  for (std::size_t i = 0; i + 1 < count; ++i) {
    low += off[i].first;
    const auto below = static_cast<float>(i + 1), above = static_cast<float>(count - i - 1);
    if (std::min(below, above) < kLeastHeap * static_cast<float>(count)) continue;
    const float apart = (all - low) / above - low / below;
    const float share = below * above / static_cast<float>(count * count) * apart * apart / second;
    if (share <= look.between) continue;
    look.between = share;
    look.apart = apart * radius;
    best = i + 1;
  }
  if (best == 0) return std::nullopt;
  Eigen::Vector2f sides[2] = {Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero()};
  for (std::size_t i = 0; i < count; ++i) {
    const auto& p = local[off[i].second];
    const bool is_above = i >= best;
    sides[is_above ? 1 : 0] += Eigen::Vector2f{p[0], p[1]} / static_cast<float>(is_above ? count - best : best);
  }
  if ((sides[0] - sides[1]).norm() > kApartAside) return std::nullopt;
  return look;
}

/// How far apart the sheets are, as a place and most of those about it say; 0 where they say there is one.
float sheets_about(const PointCloud& cloud, const KdTree& tree, std::uint32_t place, const Patch& patch) {
  const auto own = look_at(cloud, tree, place, patch);
  // A single place may look anyhow: most of these are left at once.
  if (!own || own->between < 0.9F * kBetween || own->apart < 0.7F * patch.least_apart * own->spacing) return 0;
  std::array<Neighbour, kMostPoints> near;
  const std::size_t found = tree.nearest(cloud.points[place], std::span{near}.first(patch.points));
  std::vector<float> apart, between, kurtosis, spacing;
  std::size_t asked = 0;
  for (std::size_t i = 0; i < found; i += found / kAround) {
    if (cloud.normals[near[i].index].dot(cloud.normals[place]) < kSameSide) continue;
    ++asked;
    const auto look = look_at(cloud, tree, near[i].index, patch);
    if (!look) continue;
    apart.push_back(look->apart);
    between.push_back(look->between);
    kurtosis.push_back(look->kurtosis);
    spacing.push_back(look->spacing);
  }
  if (apart.size() < 3 || 2 * apart.size() < asked) return 0;
  const float distance = median_of(apart);
  if (median_of(between) < kBetween || median_of(kurtosis) > kKurtosis ||
      distance < patch.least_apart * median_of(spacing))
    return 0;
  return distance;
}

std::vector<float> sheets_at(const PointCloud& cloud, const KdTree& tree, std::span<const std::uint32_t> places) {
  std::vector<float> apart(places.size(), 0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, places.size(), 64}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i)
      for (const Patch& patch : kPatches)
        if (apart[i] == 0) apart[i] = sheets_about(cloud, tree, places[i], patch);
  });
  return apart;
}

}  // namespace

Result<std::size_t> mark_two_sheets(PointCloud& cloud, std::stop_token stop) {
  if (!cloud.has_normals() || cloud.size() < kMostPoints) return 0;
  const KdTree tree{cloud.points};
  if (stop.stop_requested()) return cancelled("looking for two sheets");
  const auto every = [&](std::size_t step) {
    std::vector<std::uint32_t> places;
    for (std::size_t i = step / 2; i < cloud.size(); i += step) places.push_back(tree.leaf_order()[i]);
    return places;
  };
  const std::vector<std::uint32_t> first = every(std::max<std::size_t>(1, cloud.size() / kAsked));
  const std::vector<float> sample = sheets_at(cloud, tree, first);
  const auto confirmed =
      static_cast<std::size_t>(std::count_if(sample.begin(), sample.end(), [](float d) { return d > 0; }));
  if (confirmed < kFewConfirmed || static_cast<double>(confirmed) < kLeastConfirmed * static_cast<double>(first.size()))
    return 0;
  if (stop.stop_requested()) return cancelled("looking for two sheets");
  const std::vector<std::uint32_t> places = every(kPatches[0].points / kAround);
  const std::vector<float> apart = sheets_at(cloud, tree, places);
  cloud.sheets_apart.assign(cloud.size(), 0);
  std::array<Neighbour, kPatches[0].points> near;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!(apart[i] > 0)) continue;
    const std::size_t found = tree.nearest(cloud.points[places[i]], near);
    for (std::size_t k = 0; k < found; ++k)
      cloud.sheets_apart[near[k].index] = std::max(cloud.sheets_apart[near[k].index], apart[i]);
  }
  return static_cast<std::size_t>(
      std::count_if(cloud.sheets_apart.begin(), cloud.sheets_apart.end(), [](float d) { return d > 0; }));
}

}  // namespace telefab::scan
