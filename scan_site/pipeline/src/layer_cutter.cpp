#include "layer_cutter.hpp"

#include <fmt/format.h>

#include <telefab/scan/contour/layer_checks.hpp>
#include <telefab/scan/contour/reeb_marcher.hpp>

namespace telefab::scan {
namespace {

/// Samples flatter than this do not tell where, or whether, the surface meets the plane.
constexpr double kSteepNz = 0.8;

using Verdict = LayerCertificate::Verdict;
using Method = LayerCertificate::Method;

}  // namespace

struct LayerCutter::Candidate {
  Method method = Method::Grid;
  LayerTrace trace;
  std::size_t beside_graph = 0;  ///< contours that only a sample led to

  [[nodiscard]] bool sound() const { return trace.faults.empty(); }
  [[nodiscard]] ContourCount count() const {
    ContourCount c;
    for (const Contour& ring : trace.contours) ++(ring.is_hole() ? c.holes : c.outers);
    return c;
  }
};

LayerCutter::LayerCutter(const CutSetting& setting) : setting_{setting}, cursor_{setting.field.cursor()} {}

void LayerCutter::judge(Candidate& candidate, double z_mm) const {
  if (candidate.trace.contours.empty()) {
    // near_ rises in z.
    const bool through = !near_.points.empty() && near_.points.front().z() < z_mm && near_.points.back().z() > z_mm;
    if (through)
      candidate.trace.faults.push_back({"samples lie close above and below the plane, but no contour was found",
                                        {near_.points.front().x(), near_.points.front().y()}});
  }
  const auto cover = [&](const SurfaceSamples& samples) {
    return uncovered_samples(setting_.field, z_mm, candidate.trace.contours, {samples.points, samples.normals},
                             setting_.cover_kernels);
  };
  const auto raw = cover(steep_);
  if (raw.empty()) return;
  // A noisy sample says little alone: ask the surface under it, and wonder only when many samples disagree.
  const auto settled = cover(on_surface(steep_));
  const auto most = static_cast<std::size_t>(setting_.stray_share * static_cast<double>(steep_.points.size()));
  if (settled.empty() && raw.size() <= most) return;
  const Vec3& place = settled.empty() ? raw[0] : settled[0];
  candidate.trace.faults.push_back(
      {fmt::format("{} samples near the plane lie beside no contour", std::max(raw.size(), settled.size())),
       {place.x(), place.y()}});
}

SurfaceSamples LayerCutter::on_surface(const SurfaceSamples& samples) const {
  SurfaceSamples settled;
  for (const Vec3& sample : samples.points) {
    const double width = setting_.field.kernel_width_mm(sample);
    Vec3 p = sample;
    for (int i = 0; i < 8; ++i) {
      const FieldSample f = cursor_->at(p);
      const double steep2 = f.gradient.squaredNorm();
      if (!f.in_reach || !(steep2 > 0.01) || (p - sample).norm() > 2 * width) break;
      if (std::abs(f.value_mm) < 0.01 * width) {
        const Vec3 normal = f.gradient / std::sqrt(steep2);
        if (std::abs(normal.z()) <= kSteepNz) {
          settled.points.push_back(p);
          settled.normals.push_back(normal);
        }
        break;
      }
      p -= f.value_mm / steep2 * f.gradient;
    }
  }
  return settled;
}

Result<LayerCutter::Candidate> LayerCutter::marched(double z_mm, std::stop_token stop) {
  std::vector<Vec3> seeds;
  if (setting_.topology)
    for (const ContourSeed& seed : setting_.topology->seeds(z_mm)) seeds.push_back(seed.point_mm);
  MarchOptions options;
  options.chord_mm = setting_.chord_mm;
  auto marched = march_contours(setting_.field, *cursor_, z_mm, seeds, {near_.points, near_.normals}, options, stop);
  if (!marched) return tl::unexpected{marched.error()};
  Candidate candidate;
  candidate.method = Method::Reeb;
  candidate.beside_graph = marched->from_coverage;
  candidate.trace.contours = std::move(marched->contours);
  candidate.trace.evaluations = marched->evaluations;
  for (const MarchProblem& problem : marched->problems)
    if (problem.kind == MarchProblem::Kind::Open)
      candidate.trace.faults.push_back({"a contour does not close: the scan has a gap here", problem.place});
  finish_trace(candidate.trace);
  judge(candidate, z_mm);
  return candidate;
}

Result<LayerCutter::Candidate> LayerCutter::gridded(double z_mm, std::stop_token stop) {
  GridOptions options;
  options.chord_mm = setting_.chord_mm;
  options.bridge_mm = setting_.bridge_mm;
  auto trace = trace_by_grid(setting_.field, *cursor_, z_mm, {near_.points, near_.normals}, options, stop);
  if (!trace) return tl::unexpected{trace.error()};
  Candidate candidate;
  candidate.trace = std::move(*trace);
  judge(candidate, z_mm);
  return candidate;
}

Result<CutLayer> LayerCutter::cut(LayerIndex index, double z_mm, std::stop_token stop) {
  if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled while cutting layers");
  setting_.samples(z_mm - setting_.band_mm, z_mm + setting_.band_mm, near_);
  steep_.points.clear();
  steep_.normals.clear();
  for (std::size_t i = 0; i < near_.points.size(); ++i)
    if (std::abs(near_.normals[i].z()) <= kSteepNz) {
      steep_.points.push_back(near_.points[i]);
      steep_.normals.push_back(near_.normals[i]);
    }

  std::optional<int> predicted;
  std::optional<ContourCount> predicted_count;
  bool near_critical = true;
  if (setting_.topology) {
    predicted = setting_.topology->predicted_euler(z_mm);
    predicted_count = setting_.topology->predicted_contours(z_mm);
    near_critical = setting_.topology->is_near_critical(z_mm);
  }
  const auto as_predicted = [&](const Candidate& c) {
    return predicted && !near_critical && c.trace.euler() == *predicted &&
           (!predicted_count || c.count() == *predicted_count);
  };

  CutLayer result;
  std::optional<Candidate> march, grid;
  const Candidate* chosen = nullptr;
  bool certified = false;
  if (setting_.method != TraceMethod::Grid) {
    auto found = marched(z_mm, stop);
    if (!found) return tl::unexpected{found.error()};
    march = std::move(*found);
    result.evaluations += march->trace.evaluations;
    chosen = &*march;
    certified = march->sound() && as_predicted(*march);
  }
  if (!certified && setting_.method != TraceMethod::Reeb) {
    auto found = gridded(z_mm, stop);
    if (!found) return tl::unexpected{found.error()};
    grid = std::move(*found);
    result.evaluations += grid->trace.evaluations;
    if (grid->sound() && as_predicted(*grid)) {
      chosen = &*grid;
      certified = true;
    } else if (march && march->sound() && grid->sound() && march->count() == grid->count() &&
               (!predicted || near_critical || march->trace.euler() == *predicted)) {
      // Nothing is promised here, but two independent ways around the same field agree.
      certified = true;
    } else if (!march || !march->sound() || grid->sound()) {
      chosen = &*grid;
    }
  }

  Layer& layer = result.layer;
  layer.index = index;
  layer.z_mm = z_mm;
  LayerCertificate& certificate = layer.certificate;
  certificate.method = chosen->method;
  certificate.predicted_euler = predicted;
  certificate.measured_euler = chosen->trace.euler();
  const TraceFault* fault = chosen->sound() ? nullptr : &chosen->trace.faults[0];
  if (!fault && setting_.known_fault) fault = &*setting_.known_fault;
  if (certified && !fault) {
    certificate.verdict = Verdict::Certified;
  } else {
    certificate.verdict = Verdict::Flagged;
    if (fault) {
      certificate.reason = fault->what;
      certificate.place = fault->place;
    } else if (predicted && !near_critical) {
      certificate.reason = fmt::format("the critical points predict an Euler number of {}, the contours have {}",
                                       *predicted, certificate.measured_euler);
    } else if (march && grid) {
      certificate.reason =
          fmt::format("at a critical height marching finds {} outer and {} hole contours, the grid {} and {}",
                      march->count().outers, march->count().holes, grid->count().outers, grid->count().holes);
    } else {
      certificate.reason = "too near to a critical height to be checked by one method alone";
    }
    if (!certificate.place && !chosen->trace.contours.empty())
      certificate.place = chosen->trace.contours[0].vertices()[0];
  }
  LayerTrace& taken = (chosen == (march ? &*march : nullptr) ? march : grid)->trace;
  layer.contours = std::move(taken.contours);
  result.gaps = std::move(taken.gaps);
  return result;
}

}  // namespace telefab::scan
