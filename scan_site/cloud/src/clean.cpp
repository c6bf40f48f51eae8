// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/clean.hpp>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <tuple>

#include "surface_graph.hpp"

namespace telefab::scan {
namespace {

PointCloud select(PointCloud cloud, std::span<const PointFate> fate) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    if (fate[i] == PointFate::Kept) cloud.copy_point(i, kept++);
  cloud.shrink(kept);
  cloud.notes.clear();
  return cloud;
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void mark_duplicates(const PointCloud& cloud, std::vector<PointFate>& fate) {
  std::vector<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  const auto key = [&](std::uint32_t i) {
    return std::tuple{cloud.points[i].x(), cloud.points[i].y(), cloud.points[i].z(), i};
  };
  std::sort(order.begin(), order.end(), [&](std::uint32_t l, std::uint32_t r) { return key(l) < key(r); });
  for (std::size_t k = 1; k < order.size(); ++k)
    if (cloud.points[order[k]] == cloud.points[order[k - 1]]) fate[order[k]] = PointFate::Duplicate;
}

std::vector<std::uint32_t> kept_indices(std::span<const PointFate> fate) {
  std::vector<std::uint32_t> kept;
  for (std::uint32_t i = 0; i < fate.size(); ++i)
    if (fate[i] == PointFate::Kept) kept.push_back(i);
  return kept;
}

/// Mean distance to the neighbours, one a point of the tree.
std::vector<float> reach_of_points(const KdTree& tree, std::span<const Eigen::Vector3f> points, std::size_t k) {
  std::vector<float> reach(points.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, points.size(), 1024}, [&](const auto& range) {
    std::vector<Neighbour> found(k + 1);
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const std::size_t count = tree.nearest(points[i], found);
      float sum = 0;
      for (std::size_t j = 0; j < count; ++j) sum += std::sqrt(found[j].squared_distance);
      reach[i] = sum / static_cast<float>(std::max<std::size_t>(count - 1, 1));
    }
  });
  return reach;
}

/// A point is an outlier when its neighbours are much farther from it than its neighbours' neighbours from them: a
/// measure that follows the density, so sparse regions are not taken for outliers.
void mark_outliers(const PointCloud& cloud, const CleanOptions& options, std::vector<PointFate>& fate) {
  const std::vector<std::uint32_t> kept = kept_indices(fate);
  std::vector<Eigen::Vector3f> points;
  for (const std::uint32_t i : kept) points.push_back(cloud.points[i]);
  const KdTree tree{points};
  const auto k = static_cast<std::size_t>(options.neighbours);
  const std::vector<float> reach = reach_of_points(tree, points, k);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, points.size(), 1024}, [&](const auto& range) {
    std::vector<Neighbour> found(k + 1);
    std::vector<float> around;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const std::size_t count = tree.nearest(points[i], found);
      around.clear();
      for (std::size_t j = 0; j < count; ++j)
        if (found[j].index != i) around.push_back(reach[found[j].index]);
      if (around.empty()) continue;
      std::nth_element(around.begin(), around.begin() + static_cast<std::ptrdiff_t>(around.size() / 4), around.end());
      if (static_cast<double>(reach[i]) > options.outlier_factor * static_cast<double>(around[around.size() / 4]))
        fate[kept[i]] = PointFate::Outlier;
    }
  });
}

struct Clusters {
  std::vector<std::uint32_t> of;
  std::vector<std::size_t> size;
};

Clusters find_clusters(std::span<const Eigen::Vector3f> points, float reach) {
  const KdTree tree{points};
  Clusters clusters;
  clusters.of.assign(points.size(), UINT32_MAX);
  std::vector<std::uint32_t> front;
  for (std::uint32_t seed = 0; seed < points.size(); ++seed) {
    if (clusters.of[seed] != UINT32_MAX) continue;
    const auto name = static_cast<std::uint32_t>(clusters.size.size());
    clusters.size.push_back(0);
    clusters.of[seed] = name;
    front.push_back(seed);
    std::vector<Neighbour> found(24);
    while (!front.empty()) {
      const std::uint32_t at = front.back();
      front.pop_back();
      ++clusters.size[name];
      const std::size_t count = tree.nearest(points[at], found);
      for (std::size_t j = 0; j < count; ++j)
        if (found[j].squared_distance < reach * reach && clusters.of[found[j].index] == UINT32_MAX) {
          clusters.of[found[j].index] = name;
          front.push_back(found[j].index);
        }
    }
  }
  return clusters;
}

/// Height of the quadric through a point's neighbours above the point, along its normal, and the fit's residual.
struct QuadricFit {
  double height = 0;
  double residual = 0;
};

std::vector<QuadricFit> fit_quadrics(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  std::vector<QuadricFit> fits(points.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, points.size(), 1024}, [&](const auto& range) {
    Eigen::Matrix<double, 6, 6> normal;
    Eigen::Matrix<double, 6, 1> right, row;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const Vec3 n = graph.normal[i].cast<double>(), u = n.unitOrthogonal(), v = n.cross(u);
      const auto near = graph.neighbours_of(i);
      const double scale = (points[near.back()] - points[i]).norm();
      if (near.size() < 10 || !(scale > 0)) continue;
      normal.setZero();
      right.setZero();
      const auto place = [&](std::uint32_t j) { return Vec3{(points[j] - points[i]).cast<double>() / scale}; };
      const auto basis = [&](const Vec3& d) {
        const double x = d.dot(u), y = d.dot(v);
        row << 1, x, y, x * x, x * y, y * y;
      };
      double square = 0;
      basis(Vec3::Zero());
      normal += row * row.transpose();
      for (const std::uint32_t j : near) {
        const Vec3 d = place(j);
        basis(d);
        normal += row * row.transpose();
        right += row * d.dot(n);
        square += d.dot(n) * d.dot(n);
      }
      normal.diagonal().array() += 1e-9;
      const Eigen::Matrix<double, 6, 1> fit = normal.ldlt().solve(right);
      const double left = std::max(0.0, square - fit.dot(right));
      fits[i] = {fit[0] * scale, std::sqrt(left / static_cast<double>(near.size() + 1 - 6)) * scale};
    }
  });
  return fits;
}

/// Half of the points have a smaller residual; sharp edges and detail lie in the other half.
double noise_of(std::span<const QuadricFit> fits) {
  std::vector<double> residuals;
  for (const QuadricFit& f : fits) residuals.push_back(f.residual);
  return percentile(std::move(residuals), 0.5);
}

}  // namespace

Result<void> CleanOptions::validate() const {
  if (neighbours < 6 || neighbours > 64)
    return fail(ErrorCode::InvalidInput, fmt::format("neighbours is {}; 6 to 64 are possible", neighbours));
  if (!(outlier_factor > 1))
    return fail(ErrorCode::InvalidInput, fmt::format("outlier_factor is {}; it must be above 1", outlier_factor));
  if (!(cluster_reach > 0))
    return fail(ErrorCode::InvalidInput, fmt::format("cluster_reach is {}; it must be above 0", cluster_reach));
  if (!(least_cluster >= 0 && least_cluster < 1))
    return fail(ErrorCode::InvalidInput, fmt::format("least_cluster is {}; 0 to below 1 is possible", least_cluster));
  return {};
}

CleanOptions CleanOptions::careful() {
  return {.outlier_factor = 4, .cluster_reach = 8, .least_cluster = 0.0005, .smooth = false};
}
CleanOptions CleanOptions::strong() {
  return {.outlier_factor = 2.2, .cluster_reach = 4, .least_cluster = 0.01, .smooth = true};
}

Result<CleanResult> clean_cloud(const PointCloud& cloud, const CleanOptions& options, std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  if (cloud.size() < 10)
    return fail(ErrorCode::InvalidInput, fmt::format("{} points; at least 10 are needed", cloud.size()));
  CleanResult result;
  CleanReport& report = result.report;
  report.points_in = cloud.size();
  result.fate.assign(cloud.size(), PointFate::Kept);
  mark_duplicates(cloud, result.fate);
  mark_outliers(cloud, options, result.fate);
  if (stop.stop_requested()) return cancelled("cleaning");

  std::vector<std::uint32_t> kept = kept_indices(result.fate);
  PointCloud rest = select(cloud, result.fate);
  const auto k = static_cast<std::size_t>(std::max(options.neighbours, 20));
  auto graph = build_surface_graph(rest.points, k, stop);
  if (!graph) return tl::unexpected{graph.error()};
  const Clusters clusters = find_clusters(rest.points, static_cast<float>(options.cluster_reach) * graph->spacing);
  const double least = options.least_cluster * static_cast<double>(rest.size());
  for (const std::size_t size : clusters.size) report.clusters_removed += static_cast<double>(size) < least ? 1 : 0;
  for (std::size_t i = 0; i < kept.size(); ++i)
    if (static_cast<double>(clusters.size[clusters.of[i]]) < least) result.fate[kept[i]] = PointFate::SmallCluster;
  for (const PointFate f : result.fate) {
    report.duplicates += f == PointFate::Duplicate ? 1 : 0;
    report.outliers += f == PointFate::Outlier ? 1 : 0;
    report.cluster_points += f == PointFate::SmallCluster ? 1 : 0;
  }
  result.cloud = select(cloud, result.fate);
  if (result.cloud.size() < 10)
    return fail(ErrorCode::InvalidInput,
                "nothing is left after cleaning: the cloud is noise, or the options are too strict");
  if (report.cluster_points > 0) graph = build_surface_graph(result.cloud.points, k, stop);
  if (!graph) return tl::unexpected{graph.error()};

  report.spacing = static_cast<double>(graph->spacing);
  std::vector<double> spacings;
  for (const float a : graph->area) spacings.push_back(std::sqrt(static_cast<double>(a)));
  report.unevenness = percentile(spacings, 0.95) / std::max(percentile(spacings, 0.05), 1e-300);
  const std::vector<QuadricFit> fits = fit_quadrics(result.cloud.points, *graph);
  report.noise = report.noise_after = noise_of(fits);
  if (options.smooth) {
    double square = 0;
    for (std::size_t i = 0; i < fits.size(); ++i) {
      // never farther than three sigmas: an edge must not be rounded away for noise
      const double move = std::clamp(fits[i].height, -3 * report.noise, 3 * report.noise);
      result.cloud.points[i] += graph->normal[i] * static_cast<float>(move);
      square += move * move;
      report.moved_max = std::max(report.moved_max, std::abs(move));
    }
    report.moved_rms = std::sqrt(square / static_cast<double>(fits.size()));
    report.noise_after = noise_of(fit_quadrics(result.cloud.points, *graph));
  }
  return result;
}

std::string to_json(const CleanReport& r) {
  return fmt::format(
      R"({{"points_in":{},"duplicates":{},"outliers":{},"cluster_points":{},"clusters_removed":{},"spacing":{:.9g},"unevenness":{:.6g},"noise":{:.6g},"noise_after":{:.6g},"moved_rms":{:.6g},"moved_max":{:.6g}}})",
      r.points_in, r.duplicates, r.outliers, r.cluster_points, r.clusters_removed, r.spacing, r.unevenness, r.noise,
      r.noise_after, r.moved_rms, r.moved_max);
}

}  // namespace telefab::scan
