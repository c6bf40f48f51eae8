// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/doubled_sheets.hpp>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <telefab/base/median.hpp>
#include <tuple>

#include "adjust.hpp"

namespace telefab::scan {
namespace {

constexpr float kPatch = 2.5F;     ///< radius of the points that make a plane, spacings
constexpr float kSearched = 5;     ///< farthest sheet, spacings
constexpr float kSameSide = 0.7F;  ///< cosine between normals of one sheet
constexpr float kLeastWeight =
    0.3F;  ///< cosine of incidence; what is seen flatter is wrong by its own, and hardly counts in a merge
constexpr std::size_t kFewPoints = 6;
constexpr float kAround = 6;           ///< places within so many spacings are asked together
constexpr std::size_t kFewPlaces = 5;  ///< fewer tell nothing
/// Sheets are apart by more than the points scatter about their own plane, and by so many spacings: real scanners are
/// wrong by a third of one here and there,
constexpr float kLeastApart = 0.5F;
/// but not nearly everywhere, as where a pose is wrong.
constexpr float kLeastApartAll = 0.25F;
constexpr double kNearlyAll = 0.5;
constexpr double kLeastShare = 0.03;  ///< of what two views see together; less is no pair of sheets
/// Matches are rejected beyond these, in spacings, when sheets are brought together; first and last round.
constexpr double kFirstReach = 8, kLastReach = 3;
constexpr float kOffMiddle = 0.5F;  ///< radii between the middle of a plane's points and the place

/// One view's points in the world, those that are good enough to be merged.
struct PlacedView {
  std::vector<Eigen::Vector3f> points, normals;
  std::vector<std::uint32_t> index;  ///< in the view
};

PlacedView place(const RangeImage& view, const RigidMotion& pose, const Vec3& origin) {
  PlacedView placed;
  for (std::uint32_t i = 0; i < view.points.size(); ++i) {
    if (view.weight[i] < kLeastWeight) continue;
    placed.points.push_back((pose * view.points[i].cast<double>() - origin).cast<float>());
    placed.normals.push_back((pose.rotation() * view.normals[i].cast<double>()).cast<float>());
    placed.index.push_back(i);
  }
  return placed;
}

struct Plane {
  float height = 0;  ///< above the place, along the normal asked for
  float sigma = 0;   ///< of the points about it
};

/// The plane of the points of `view` about a place; nothing where they do not surround it.
std::optional<Plane> plane_at(const PlacedView& view, const KdTree& tree, const Eigen::Vector3f& at,
                              const Eigen::Vector3f& normal, float radius, float height) {
  const Eigen::Vector3f u = normal.unitOrthogonal(), v = normal.cross(u);
  Eigen::Matrix3f square = Eigen::Matrix3f::Zero();
  Eigen::Vector3f right = Eigen::Vector3f::Zero();
  float sum2 = 0;
  std::size_t count = 0;
  for (const Neighbour& near : tree.within(at, std::hypot(radius, height))) {
    if (view.normals[near.index].dot(normal) < kSameSide) continue;
    const Eigen::Vector3f d = view.points[near.index] - at;
    const float x = d.dot(u), y = d.dot(v), h = d.dot(normal);
    if (x * x + y * y > radius * radius || std::abs(h) > height) continue;
    const Eigen::Vector3f row{1, x, y};
    square += row * row.transpose();
    right += h * row;
    sum2 += h * h;
    ++count;
  }
  if (count < kFewPoints) return std::nullopt;
  const auto n = static_cast<float>(count);
  if (std::hypot(square(0, 1), square(0, 2)) / n > kOffMiddle * radius) return std::nullopt;
  const Eigen::Vector3f fit = square.ldlt().solve(right);
  if (!fit.allFinite()) return std::nullopt;
  return Plane{fit[0], std::sqrt(std::max(0.F, sum2 - fit.dot(right)) / (n - 3))};
}

/// A place that two views show.
struct Place {
  Eigen::Vector3f at, normal;
  float between = 0;  ///< from the first view's plane to the second's, along the normal
  float sigma = 0;
};

/// Points of the view, one a cube of this size.
std::vector<std::uint32_t> spread(const PlacedView& view, float cube) {
  std::vector<std::tuple<std::int64_t, std::int64_t, std::int64_t, std::uint32_t>> order;
  order.reserve(view.points.size());
  const auto cell = [&](float c) { return static_cast<std::int64_t>(std::floor(c / cube)); };
  for (std::uint32_t i = 0; i < view.points.size(); ++i) {
    const Eigen::Vector3f& p = view.points[i];
    order.emplace_back(cell(p.x()), cell(p.y()), cell(p.z()), i);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::uint32_t> chosen;
  for (std::size_t k = 0; k < order.size();) {
    std::size_t end = k;
    while (end < order.size() && std::get<0>(order[end]) == std::get<0>(order[k]) &&
           std::get<1>(order[end]) == std::get<1>(order[k]) && std::get<2>(order[end]) == std::get<2>(order[k]))
      ++end;
    chosen.push_back(std::get<3>(order[k + (end - k) / 2]));
    k = end;
  }
  return chosen;
}

std::vector<Place> shared_places(const PlacedView& first, const KdTree& first_tree,
                                 std::span<const std::uint32_t> asked, const PlacedView& second,
                                 const KdTree& second_tree, float spacing) {
  std::vector<std::optional<Place>> found(asked.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, asked.size(), 128}, [&](const auto& range) {
    for (std::size_t k = range.begin(); k < range.end(); ++k) {
      const Eigen::Vector3f &at = first.points[asked[k]], &normal = first.normals[asked[k]];
      if (second_tree.nearest(at).squared_distance > 2 * kSearched * kSearched * spacing * spacing) continue;
      const auto there = plane_at(second, second_tree, at, normal, kPatch * spacing, kSearched * spacing);
      if (!there) continue;
      const auto here = plane_at(first, first_tree, at, normal, kPatch * spacing, kSearched * spacing);
      if (!here) continue;
      found[k] =
          Place{at, normal, there->height - here->height, std::hypot(here->sigma, there->sigma) / std::sqrt(2.F)};
    }
  });
  std::vector<Place> places;
  for (const auto& place : found)
    if (place) places.push_back(*place);
  return places;
}

/// How far apart the sheets are about each place; 0 where there is one sheet.
std::vector<float> sheets_about(std::span<const Place> places, float spacing) {
  std::vector<Eigen::Vector3f> at;
  for (const Place& p : places) at.push_back(p.at);
  const KdTree tree{at};
  std::vector<float> apart(places.size(), 0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, places.size(), 256}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      std::vector<float> between, sigma;
      for (const Neighbour& near : tree.within(places[i].at, kAround * spacing)) {
        if (places[near.index].normal.dot(places[i].normal) < kSameSide) continue;
        between.push_back(places[near.index].between);
        sigma.push_back(places[near.index].sigma);
      }
      if (between.size() < kFewPlaces) continue;
      const float distance = std::abs(median_of(std::move(between)));
      if (distance >= kLeastApartAll * spacing && distance >= median_of(std::move(sigma))) apart[i] = distance;
    }
  });
  return apart;
}

std::size_t doubled_points(const DoubledSheets& sheets) {
  std::size_t count = 0;
  for (const auto& view : sheets.apart)
    count += static_cast<std::size_t>(std::count_if(view.begin(), view.end(), [](float d) { return d > 0; }));
  return count;
}

}  // namespace

Result<DoubledSheets> find_doubled_sheets(std::span<const RangeImage> views, std::span<const RigidMotion> poses,
                                          std::stop_token stop) {
  if (views.size() != poses.size()) return fail(ErrorCode::InvalidInput, "one pose a view is needed");
  DoubledSheets result;
  float spacing = 0;
  Vec3 origin = Vec3::Zero();
  std::vector<PlacedView> placed;
  std::vector<KdTree> trees;
  std::vector<std::vector<std::uint32_t>> asked;
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (v == 0 && !views[0].points.empty()) origin = poses[0] * views[0].points[0].cast<double>();
    spacing = std::max(spacing, views[v].spacing);
    result.apart.emplace_back(views[v].points.size(), 0.F);
  }
  for (std::size_t v = 0; v < views.size(); ++v) {
    placed.push_back(place(views[v], poses[v], origin));
    trees.emplace_back(placed[v].points);
    asked.push_back(spread(placed[v], kPatch * spacing));
  }
  const auto mark = [&](std::size_t v, const Eigen::Vector3f& at, float distance) {
    for (const Neighbour& near : trees[v].within(at, std::hypot(kPatch * spacing, distance))) {
      float& worst = result.apart[v][placed[v].index[near.index]];
      worst = std::max(worst, distance);
    }
  };
  for (std::size_t a = 0; a < views.size(); ++a)
    for (std::size_t b = a + 1; b < views.size(); ++b) {
      if (stop.stop_requested()) return cancelled("looking for doubled sheets");
      if (placed[a].points.empty() || placed[b].points.empty()) continue;
      const std::vector<Place> places = shared_places(placed[a], trees[a], asked[a], placed[b], trees[b], spacing);
      if (places.size() < kFewPlaces) continue;
      result.shared.push_back({a, b});
      std::vector<float> apart = sheets_about(places, spacing);
      const auto share_of = [&](float least) {
        const auto count = std::count_if(apart.begin(), apart.end(), [&](float d) { return d >= least; });
        return static_cast<double>(count) / static_cast<double>(apart.size());
      };
      if (share_of(kLeastApartAll * spacing) < kNearlyAll)
        for (float& d : apart) d = d < kLeastApart * spacing ? 0 : d;
      std::vector<float> doubled;
      std::size_t farthest = 0;
      for (std::size_t i = 0; i < apart.size(); ++i) {
        if (apart[i] > 0) doubled.push_back(apart[i]);
        if (apart[i] > apart[farthest]) farthest = i;
      }
      const double share = static_cast<double>(doubled.size()) / static_cast<double>(places.size());
      if (share < kLeastShare || doubled.size() < kFewPlaces) continue;
      result.pairs.push_back(
          {a, b, static_cast<double>(median_of(doubled)), share, origin + places[farthest].at.cast<double>()});
      for (std::size_t i = 0; i < apart.size(); ++i)
        if (apart[i] > 0)
          for (const std::size_t v : {a, b}) mark(v, places[i].at, apart[i]);
    }
  std::stable_sort(result.pairs.begin(), result.pairs.end(),
                   [](const DoubledPair& l, const DoubledPair& r) { return l.apart > r.apart; });
  return result;
}

Result<DoubledSheets> reconcile_doubled_sheets(std::span<const RangeImage> views, std::vector<RigidMotion>& poses,
                                               std::stop_token stop) {
  auto found = find_doubled_sheets(views, poses, stop);
  if (!found || found->empty()) return found;
  std::vector<AlignTarget> targets;
  double spacing = 0;
  for (const RangeImage& v : views) {
    targets.emplace_back(v.points, v.normals);
    spacing = std::max(spacing, static_cast<double>(v.spacing));
  }
  std::vector<Link> links;
  for (const auto& [a, b] : found->shared) {
    links.push_back({a, b});
    links.push_back({b, a});
  }
  std::vector<RigidMotion> adjusted = poses;
  const double far = found->pairs.front().apart;
  const auto matches = adjust_all(
      views, targets, links,
      {.first_reach = std::max(kFirstReach * spacing, 2 * far), .last_reach = kLastReach * spacing}, adjusted, stop);
  if (!matches) {
    if (matches.error().code == ErrorCode::Cancelled) return tl::unexpected{matches.error()};
    return found;
  }
  auto again = find_doubled_sheets(views, adjusted, stop);
  if (!again) return again;
  if (doubled_points(*again) >= doubled_points(*found)) return found;
  poses = std::move(adjusted);
  return again;
}

std::string sentence_of(const DoubledPair& pair, std::span<const RangeImage> views) {
  return fmt::format("{} and {} show two sheets {:.3g} apart on {:.0f} % of what both see", views[pair.first].name,
                     views[pair.second].name, pair.apart, 100 * pair.share);
}

}  // namespace telefab::scan
