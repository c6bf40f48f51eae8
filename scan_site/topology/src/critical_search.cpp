// SPDX-License-Identifier: GPL-3.0-or-later
#include "critical_search.hpp"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <memory>
#include <unordered_map>

#include "cells.hpp"

namespace telefab::scan::topology {
namespace {

constexpr double kDifferenceKernels = 0.02;  // of the central differences
constexpr double kStepKernels = 0.5;
constexpr double kWanderKernels = 3.0;
constexpr double kMergeKernels = 0.1;
constexpr double kOtherKindShare = 0.02;
constexpr double kDegenerateBend = 2e-4;  // times 1/h: what the differences of a float field can still tell from none
constexpr int kIterations = 25;

bool lower(const Vec3& a, const Vec3& b) { return std::tuple(a.z(), a.x(), a.y()) < std::tuple(b.z(), b.x(), b.y()); }

struct Local {
  FieldSample sample;
  Eigen::Matrix3d hessian;  ///< symmetric
};

std::optional<Local> second_order(FieldCursor& cursor, const Vec3& p, double h) {
  Local local{cursor.at(p), Eigen::Matrix3d::Zero()};
  if (!local.sample.in_reach) return std::nullopt;
  const double d = kDifferenceKernels * h;
  for (int axis = 0; axis < 3; ++axis) {
    const FieldSample ahead = cursor.at(p + d * Vec3::Unit(axis));
    const FieldSample behind = cursor.at(p - d * Vec3::Unit(axis));
    if (!ahead.in_reach || !behind.in_reach) return std::nullopt;
    local.hessian.col(axis) = (ahead.gradient - behind.gradient) / (2 * d);
  }
  local.hessian = (0.5 * (local.hessian + local.hessian.transpose())).eval();
  if (!local.hessian.allFinite() || !local.sample.gradient.allFinite()) return std::nullopt;
  return local;
}

CriticalPoint classified(const Vec3& p, const Local& local, double h) {
  CriticalPoint c;
  c.position_mm = p;
  const double gz = local.sample.gradient.z();
  c.normal_up = gz > 0;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> bend{Eigen::Matrix2d{-local.hessian.topLeftCorner<2, 2>() / gz}};
  c.curvature_per_mm = bend.eigenvalues();
  c.axes = bend.eigenvectors();
  c.degenerate = c.curvature_per_mm.cwiseAbs().minCoeff() * h < kDegenerateBend;
  if (c.curvature_per_mm[0] > 0)
    c.kind = CriticalKind::Minimum;
  else if (c.curvature_per_mm[1] < 0)
    c.kind = CriticalKind::Maximum;
  else
    c.kind = c.normal_up ? CriticalKind::BottomSaddle : CriticalKind::TopSaddle;
  return c;
}

std::optional<CriticalPoint> newton(FieldCursor& cursor, const Vec3& start, double h, double longest_first_step) {
  Vec3 p = start;
  for (int i = 0; i < kIterations; ++i) {
    const auto local = second_order(cursor, p, h);
    if (!local) return std::nullopt;
    const FieldSample& f = local->sample;
    // Rows without dimension: the two derivatives times h. Directions without bend are left alone, so that on a
    // plateau every start stays where it is.
    Eigen::Matrix3d rows;
    rows.row(0) = f.gradient.transpose();
    rows.row(1) = h * local->hessian.row(0);
    rows.row(2) = h * local->hessian.row(1);
    const Vec3 rest{f.value_mm, h * f.gradient.x(), h * f.gradient.y()};
    Eigen::JacobiSVD<Eigen::Matrix3d> svd{rows, Eigen::ComputeFullU | Eigen::ComputeFullV};
    const Vec3 singular = svd.singularValues();
    const Vec3 along = svd.matrixU().transpose() * rest;
    Vec3 step = Vec3::Zero();
    for (int k = 0; k < 3; ++k)
      if (singular[k] > kDegenerateBend) step -= along[k] / singular[k] * svd.matrixV().col(k);
    const double length = step.norm();
    if (i == 0 && length > longest_first_step) return std::nullopt;
    if (length < 1e-5 * h || (i > 8 && length < 1e-4 * h)) {
      // Level at all? A slope along a direction without bend is no critical point.
      const double slope = f.gradient.head<2>().norm() / f.gradient.norm();
      if (slope > 1e-3 || std::abs(f.value_mm) > 1e-3 * h || std::abs(f.closeness_mm) > 0.5 * h) return std::nullopt;
      return classified(p, *local, h);
    }
    p += length > kStepKernels * h ? Vec3{step * (kStepKernels * h / length)} : step;
    if ((p - start).norm() > kWanderKernels * h) return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

std::vector<Vec3> candidates(const ScalarField& field, std::span<const Vec3> samples, std::span<const Vec3> normals,
                             const SearchWidth& width) {
  struct Aligned {
    std::uint64_t key;
    double nz;
    std::size_t sample;
  };
  std::vector<Aligned> level;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double nz = normals[i].z();
    if (std::abs(nz) < width.least_nz) continue;
    // Cell sizes go in octaves of the local kernel.
    const int octave = static_cast<int>(std::lround(std::log2(field.kernel_width_mm(samples[i]))));
    const double size = width.cell_kernels * std::exp2(octave);
    const std::uint64_t key =
        (key_of(cell_of(samples[i], size)) ^ static_cast<std::uint64_t>(octave + 64) << 56) << 1 | (nz > 0 ? 1u : 0u);
    level.push_back({key, std::abs(nz), i});
  }
  tbb::parallel_sort(level.begin(), level.end(), [&](const Aligned& a, const Aligned& b) {
    if (a.key != b.key) return a.key < b.key;
    if (a.nz != b.nz) return a.nz > b.nz;
    return lower(samples[a.sample], samples[b.sample]);
  });
  std::vector<Vec3> starts;
  for (std::size_t i = 0; i < level.size(); ++i)
    if (i == 0 || level[i].key != level[i - 1].key) starts.push_back(samples[level[i].sample]);
  tbb::parallel_sort(starts.begin(), starts.end(), lower);
  return starts;
}

Result<std::vector<CriticalPoint>> find_critical_points(const ScalarField& field, std::span<const Vec3> starts,
                                                        const SearchWidth& width, std::stop_token stop) {
  // Few starts lead anywhere: keep those only.
  struct Found {
    std::size_t start;
    CriticalPoint point;
  };
  struct Searcher {
    std::unique_ptr<FieldCursor> cursor;
    std::vector<Found> found;
  };
  tbb::enumerable_thread_specific<Searcher> searchers([&] { return Searcher{field.cursor(), {}}; });
  const std::vector<std::uint32_t> order = by_cell(field, starts);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, starts.size(), 32), [&](const auto& range) {
    if (stop.stop_requested()) return;
    Searcher& searcher = searchers.local();
    for (std::size_t k = range.begin(); k < range.end(); ++k) {
      const std::size_t i = order[k];
      const double h = field.kernel_width_mm(starts[i]);
      if (const auto point = newton(*searcher.cursor, starts[i], h, width.first_step_kernels * h))
        searcher.found.push_back({i, *point});
    }
  });
  if (stop.stop_requested()) return cancelled("searching critical points");

  std::vector<Found> found;
  for (const Searcher& searcher : searchers) found.insert(found.end(), searcher.found.begin(), searcher.found.end());
  std::sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.start < b.start; });
  std::vector<CriticalPoint> all;
  all.reserve(found.size());
  for (const Found& f : found) all.push_back(f.point);
  return merged(field, {}, all);
}

std::vector<CriticalPoint> merged(const ScalarField& field, std::vector<CriticalPoint> points,
                                  std::span<const CriticalPoint> more) {
  double widest = 0;
  for (const CriticalPoint& c : points) widest = std::max(widest, field.kernel_width_mm(c.position_mm));
  for (const CriticalPoint& c : more) widest = std::max(widest, field.kernel_width_mm(c.position_mm));
  if (!(widest > 0)) return points;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> taken;
  const auto cell = [&](const CriticalPoint& c) { return cell_of(c.position_mm, kMergeKernels * widest); };
  for (std::size_t i = 0; i < points.size(); ++i) taken[key_of(cell(points[i]))].push_back(i);
  for (const CriticalPoint& c : more) {
    const double near = kMergeKernels * field.kernel_width_mm(c.position_mm);
    bool known = false;
    around(cell(c), [&](std::uint64_t key) {
      if (const auto at = taken.find(key); at != taken.end())
        for (const std::size_t k : at->second)
          // A birth of two kinds side by side stays two points.
          known = known || (points[k].position_mm - c.position_mm).norm() <
                               (points[k].kind == c.kind ? near : kOtherKindShare * near);
    });
    if (known) continue;
    taken[key_of(cell(c))].push_back(points.size());
    points.push_back(c);
  }
  std::sort(points.begin(), points.end(),
            [](const auto& a, const auto& b) { return lower(a.position_mm, b.position_mm); });
  return points;
}

}  // namespace telefab::scan::topology
