// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/scan/completion/complete_cloud.hpp>

#include "follow.hpp"
#include "relax.hpp"
#include "rims.hpp"

namespace telefab::scan {
namespace {

/// Gaps are followed this far from the nearest sample unless somebody says otherwise, in diagonals of the cloud.
constexpr double kMostGapDiagonals = 0.25;

double diagonal_of(std::span<const Eigen::Vector3f> points) {
  Eigen::Vector3f low = points[0], high = points[0];
  for (const Eigen::Vector3f& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return static_cast<double>((high - low).norm());
}

/// Spacing of the virtual samples among all samples, by their tenth neighbour; never finer than they were set.
void measure_spacing(const MeasuredSide& measured, std::vector<VirtualSample>& samples) {
  std::vector<Eigen::Vector3f> points{measured.points.begin(), measured.points.end()};
  std::vector<Eigen::Vector3f> normals{measured.normals.begin(), measured.normals.end()};
  for (const VirtualSample& s : samples) {
    points.push_back(s.point);
    normals.push_back(s.normal);
  }
  const KdTree near{points};
  tbb::parallel_for(std::size_t{0}, samples.size(), [&](std::size_t i) {
    const auto sample = static_cast<std::uint32_t>(measured.points.size() + i);
    samples[i].spacing = std::max(std::sqrt(area_of(near, points, normals, sample)), samples[i].spacing);
  });
}

}  // namespace

Result<void> CompletionOptions::validate() const {
  if (most_gap && !(std::isfinite(*most_gap) && *most_gap > 0))
    return fail(ErrorCode::InvalidInput, fmt::format("a gap of {} is not above 0", *most_gap));
  if (!(most_share > 0 && most_share <= 10))
    return fail(ErrorCode::InvalidInput, fmt::format("a share of {} virtual samples is not in (0, 10]", most_share));
  if (!(noise >= 0 && std::isfinite(noise)))
    return fail(ErrorCode::InvalidInput, fmt::format("a noise of {} is not 0 or above", noise));
  if (rounds < 0 || rounds > 100)
    return fail(ErrorCode::InvalidInput, fmt::format("{} rounds of relaxation are not in [0, 100]", rounds));
  return {};
}

std::vector<float> sample_areas(std::span<const Eigen::Vector3f> points, std::span<const Eigen::Vector3f> normals) {
  if (points.empty()) return {};
  const KdTree near{points};
  auto around = look_around(near, points, normals, {});
  return std::move(around->area);
}

Result<Completion> complete_cloud(const PointCloud& cloud, const CompletionOptions& options,
                                  const ProgressSink& progress, std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (cloud.points.empty() || cloud.normals.size() != cloud.points.size())
    return fail(ErrorCode::InvalidInput, "gaps are closed in oriented clouds only: the scan has no normals");
  report(progress, WorkStage::ClosingGaps, 0);
  const KdTree near{cloud.points};
  const auto around = look_around(near, cloud.points, cloud.normals, stop);
  if (!around) return tl::unexpected{around.error()};
  Completion completion;
  completion.areas = around->area;
  const float spacing = around->median_spacing();
  completion.spacing = static_cast<double>(spacing);
  if (!(spacing > 0)) return completion;
  const RimReach reach = RimReach::at_noise(options.noise / completion.spacing);
  const auto rims = find_rims(near, cloud.points, cloud.normals, *around, reach, stop);
  if (!rims) return tl::unexpected{rims.error()};
  completion.rim_samples = rims->size();
  if (rims->empty()) return completion;

  const WindingTree tree{cloud.points, cloud.normals, around->area};
  const MeasuredSide measured{cloud.points, cloud.normals, around->area, around->spacing, near, tree, spacing};
  const double most_gap = options.most_gap.value_or(kMostGapDiagonals * diagonal_of(cloud.points));
  const auto most = static_cast<std::size_t>(options.most_share * static_cast<double>(cloud.size()));
  if (auto ok = follow_surface(measured, *rims, reach, static_cast<float>(most_gap), most, completion, progress, stop);
      !ok)
    return tl::unexpected{ok.error()};
  if (auto ok = relax(measured, completion.samples, options.rounds, stop); !ok) return tl::unexpected{ok.error()};
  measure_spacing(measured, completion.samples);
  for (const VirtualSample& s : completion.samples)
    completion.largest_gap = std::max(completion.largest_gap, static_cast<double>(s.gap));
  return completion;
}

}  // namespace telefab::scan
