// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <telefab/scan/slicing/surface_survey.hpp>

#include "completed_scan.hpp"

namespace telefab::scan {
namespace {

/// So many samples have their sides looked at; more would show no more.
constexpr std::size_t kMostAsked = 60'000;

}  // namespace

Result<SurfaceSurvey> survey_surface(const PointCloud& prepared, const SliceRequest& request,
                                     const ProgressSink& progress, std::stop_token stop) {
  if (prepared.normals.size() != prepared.size())
    return fail(ErrorCode::InvalidInput, "a survey needs points with normals");
  auto field = MlsField::from_cloud(prepared, request.mls, stop);
  if (!field) return tl::unexpected{field.error()};
  auto closed = CompletedScan::of(**field, request, progress, stop);
  if (!closed) return tl::unexpected{closed.error()};
  const CompletedScan& scan = **closed;

  SurfaceSurvey survey;
  survey.noise = (*field)->kernel().noise_mm;
  survey.spacing = (*field)->kernel().spacing_mm;
  survey.largest_gap = scan.completion().largest_gap;
  survey.open = scan.openness();
  survey.warnings = scan.gap_warnings(request);
  SurfaceSamples kept;
  const Box3 box = (*field)->bounds();
  (*field)->samples_between(box.min.z(), box.max.z(), kept);
  for (std::size_t i = 0; i < kept.points.size(); ++i)
    survey.measured.push_back({kept.points[i], kept.normals[i].cast<float>(), SurfaceClass::Measured});
  for (const GapSample& s : scan.gap_samples())
    survey.added.push_back({s.point_mm, s.normal.cast<float>(), SurfaceClass::Completed});

  const auto judge = [&](std::vector<SurfaceSurvey::Sample>& samples) -> std::size_t {
    const std::size_t step = std::max<std::size_t>(1, (samples.size() + kMostAsked - 1) / kMostAsked);
    const std::size_t asked = (samples.size() + step - 1) / step;
    std::vector<std::uint8_t> agrees(asked, 1);
    tbb::parallel_for(std::size_t{0}, asked, [&](std::size_t k) {
      if (stop.stop_requested()) return;
      const SurfaceSurvey::Sample& s = samples[k * step];
      agrees[k] = scan.sides_agree(s.place, s.normal) ? 1 : 0;
    });
    // Samples rise in z: those in between lie near the one that was asked in height alone, so only it is marked.
    for (std::size_t k = 0; k < asked; ++k)
      if (agrees[k] == 0) samples[k * step].kind = SurfaceClass::Doubtful;
    return asked;
  };
  survey.asked = judge(survey.measured) + judge(survey.added);
  if (stop.stop_requested()) return cancelled("surveying the surface");
  if (!prepared.sheets_apart.empty()) {
    std::vector<Eigen::Vector3f> doubled;
    for (std::size_t i = 0; i < prepared.size(); ++i)
      if (prepared.sheets_apart[i] > 0) doubled.push_back(prepared.points[i]);
    if (!doubled.empty()) {
      const KdTree near{doubled};
      const double reach = survey.spacing;
      tbb::parallel_for(std::size_t{0}, survey.measured.size(), [&](std::size_t i) {
        SurfaceSurvey::Sample& s = survey.measured[i];
        const Neighbour n = near.nearest((s.place - prepared.origin).cast<float>());
        if (static_cast<double>(n.squared_distance) <= reach * reach) s.kind = SurfaceClass::Doubtful;
      });
    }
  }
  return survey;
}

}  // namespace telefab::scan
