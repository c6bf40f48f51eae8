// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/merge_views.hpp>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace telefab::scan {
namespace {

constexpr float kLeastWeight = 0.1F;  ///< cosine of incidence below which a view does not count
constexpr float kSameSide = 0.5F;     ///< cosine between normals of one surface

struct Placed {
  Eigen::Vector3f point, normal;
  float weight = 0;
  float sheets_apart = 0;
};

std::vector<std::vector<Placed>> place(std::span<const RangeImage> views, std::span<const RigidMotion> poses,
                                       const DoubledSheets* sheets, MergeReport& report) {
  std::vector<std::vector<Placed>> placed(views.size());
  for (std::size_t v = 0; v < views.size(); ++v) {
    report.points_in += views[v].points.size();
    for (std::size_t i = 0; i < views[v].points.size(); ++i) {
      if (views[v].weight[i] < kLeastWeight) {
        ++report.edge_points;
        continue;
      }
      placed[v].push_back({(poses[v] * views[v].points[i].cast<double>()).cast<float>(),
                           (poses[v].rotation() * views[v].normals[i].cast<double>()).cast<float>(), views[v].weight[i],
                           sheets ? sheets->apart[v][i] : 0});
    }
  }
  return placed;
}

}  // namespace

Result<void> MergeOptions::validate() const {
  if (!(thinning > 0 && thinning <= 4))
    return fail(ErrorCode::InvalidInput, fmt::format("thinning is {}; above 0 and up to 4 is possible", thinning));
  if (!(reach > 0)) return fail(ErrorCode::InvalidInput, "reach must be above 0");
  if (!(up.norm() > 0)) return fail(ErrorCode::InvalidInput, "up has no direction");
  return {};
}

Result<Merged> merge_views(std::span<const RangeImage> views, std::span<const RigidMotion> poses,
                           const MergeOptions& options, std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  if (views.empty() || views.size() != poses.size()) return fail(ErrorCode::InvalidInput, "one pose a view is needed");
  Merged result;
  MergeReport& report = result.report;
  const std::vector<std::vector<Placed>> placed = place(views, poses, options.sheets, report);
  float spacing = 0;
  for (const RangeImage& v : views) spacing = std::max(spacing, v.spacing);
  std::vector<KdTree> trees;
  for (const auto& view : placed) {
    std::vector<Eigen::Vector3f> points;
    for (const Placed& p : view) points.push_back(p.point);
    trees.emplace_back(points);
  }

  // Every point to the weighted mean of the views.
  const float reach = static_cast<float>(options.reach) * spacing;
  std::vector<Placed> averaged;
  std::vector<std::size_t> first(1, 0);
  for (const auto& view : placed) first.push_back(first.back() + view.size());
  averaged.resize(first.back());
  std::vector<float> moved(first.back());
  for (std::size_t v = 0; v < placed.size(); ++v) {
    if (stop.stop_requested()) return cancelled("merging");
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, placed[v].size(), 512}, [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        const Placed& p = placed[v][i];
        float weight = p.weight, offset = 0;
        Eigen::Vector3f normal = p.weight * p.normal;
        for (std::size_t w = 0; w < placed.size(); ++w) {
          if (w == v || placed[w].empty()) continue;
          const Neighbour near = trees[w].nearest(p.point);
          if (near.squared_distance > reach * reach) continue;
          const Placed& q = placed[w][near.index];
          if (q.normal.dot(p.normal) < kSameSide) continue;
          weight += q.weight;
          offset += q.weight * (q.point - p.point).dot(p.normal);
          normal += q.weight * q.normal;
        }
        moved[first[v] + i] = offset / weight;
        averaged[first[v] + i] = {p.point + p.normal * (offset / weight), normal.normalized(), weight, p.sheets_apart};
      }
    });
  }
  double square = 0;
  for (const float m : moved) square += static_cast<double>(m) * static_cast<double>(m);
  report.moved_rms = moved.empty() ? 0 : std::sqrt(square / static_cast<double>(moved.size()));

  if (options.cut_below) {
    const Eigen::Vector3f up = options.up.normalized().cast<float>();
    float lowest = std::numeric_limits<float>::max();
    for (const Placed& p : averaged) lowest = std::min(lowest, p.point.dot(up));
    const float cut = lowest + static_cast<float>(*options.cut_below);
    const auto gone =
        std::remove_if(averaged.begin(), averaged.end(), [&](const Placed& p) { return p.point.dot(up) < cut; });
    report.stand_points = static_cast<std::size_t>(averaged.end() - gone);
    averaged.erase(gone, averaged.end());
  }

  // The best point of each cube stays. Cubes are told apart by side, so that thin walls keep both faces.
  const float cube = static_cast<float>(options.thinning) * spacing;
  std::vector<std::tuple<std::int64_t, std::int64_t, std::int64_t, int, float, std::uint32_t>> order;
  order.reserve(averaged.size());
  for (std::uint32_t i = 0; i < averaged.size(); ++i) {
    const Placed& p = averaged[i];
    Eigen::Index axis = 0;
    p.normal.cwiseAbs().maxCoeff(&axis);
    const int side = static_cast<int>(2 * axis) + (p.normal[axis] < 0 ? 1 : 0);
    const auto cell = [&](float c) { return static_cast<std::int64_t>(std::floor(c / cube)); };
    order.emplace_back(cell(p.point.x()), cell(p.point.y()), cell(p.point.z()), side, -p.weight, i);
  }
  std::sort(order.begin(), order.end());
  float top = 0;
  PointCloud thin;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const auto same = [&](std::size_t a, std::size_t b) {
      const auto& [ax, ay, az, as, aw, ai] = order[a];
      const auto& [bx, by, bz, bs, bw, bi] = order[b];
      return ax == bx && ay == by && az == bz && as == bs;
    };
    if (k > 0 && same(k, k - 1)) {
      ++report.thinned_points;
      continue;
    }
    const Placed& p = averaged[std::get<5>(order[k])];
    thin.points.push_back(p.point);
    thin.normals.push_back(p.normal);
    thin.confidence.push_back(p.weight);
    if (options.sheets && !options.sheets->empty()) thin.sheets_apart.push_back(p.sheets_apart);
    top = std::max(top, p.weight);
  }
  for (float& c : thin.confidence) c = std::min(1.F, c / std::max(top, 1e-6F));
  auto cleaned = clean_cloud(thin, CleanOptions::careful(), stop);
  if (!cleaned) return tl::unexpected{cleaned.error()};
  report.cleaning = cleaned->report;
  result.cloud = std::move(cleaned->cloud);
  return result;
}

std::string to_json(const MergeReport& r) {
  return fmt::format(
      R"({{"points_in":{},"edge_points":{},"stand_points":{},"thinned_points":{},"moved_rms":{:.6g},"cleaning":{}}})",
      r.points_in, r.edge_points, r.stand_points, r.thinned_points, r.moved_rms, to_json(r.cleaning));
}

}  // namespace telefab::scan
