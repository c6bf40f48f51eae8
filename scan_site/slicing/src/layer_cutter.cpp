// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_cutter.hpp"

#include <fmt/format.h>

#include <limits>
#include <telefab/scan/contour/layer_checks.hpp>
#include <telefab/scan/contour/reeb_marcher.hpp>

#include "coverage.hpp"

namespace telefab::scan {
namespace {

/// Samples flatter than this do not tell where, or whether, the surface meets the plane.
constexpr double kSteepNz = 0.8;
/// Chord tolerance, in kernel widths, of contours that are only counted.
constexpr double kCountingChordKernels = 0.02;

using Verdict = LayerCertificate::Verdict;
using Method = LayerCertificate::Method;

/// A vertex of the smallest contour of either: what comes and goes is small.
Point2 place_of_difference(std::span<const Contour> a, std::span<const Contour> b) {
  Point2 place{};
  double least = std::numeric_limits<double>::infinity();
  for (const auto& contours : {a, b})
    for (const Contour& c : contours)
      if (const double area = std::abs(c.signed_area_mm2()); area < least) {
        least = area;
        place = c.vertices()[0];
      }
  return place;
}

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

LayerCutter::LayerCutter(const CutSetting& setting) : setting_{setting}, cursor_{setting.field.cursor()} {
  for (const ScalarField* field : setting.other_kernels) other_cursors_.push_back(field->cursor());
}

void LayerCutter::judge(Candidate& candidate, double z_mm) {
  std::vector<TraceFault>& faults = candidate.trace.faults;
  if (candidate.trace.contours.empty() && !near_.points.empty()) {
    // near_ rises in z.
    const bool through = setting_.sparse ? near_.points.front().z() < z_mm && near_.points.back().z() > z_mm
                                         : straddles(setting_.field, *cursor_, z_mm, near_);
    if (through)
      faults.push_back({"the surface passes below and above the plane, but no contour was found",
                        {near_.points.front().x(), near_.points.front().y()}});
  }
  const Coverage coverage = coverage_of(setting_.field, *cursor_, z_mm, candidate.trace.contours, steep_,
                                        setting_.cover_kernels, setting_.noise_mm);
  if (coverage.lost > 0)
    faults.push_back({fmt::format("the surface at {} samples reaches the plane beside every contour", coverage.lost),
                      *coverage.place});
  const auto most = static_cast<std::size_t>(setting_.stray_share * static_cast<double>(steep_.points.size()));
  if (coverage.unexplained > most)
    faults.push_back(
        {fmt::format("{} samples near the plane lie on no surface and beside no contour", coverage.unexplained),
         *coverage.place});
}

Result<LayerCutter::Candidate> LayerCutter::marched(double z_mm, std::span<const Vec3> seeds, std::stop_token stop) {
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

Result<std::optional<TraceFault>> LayerCutter::disagreement(const Candidate& candidate, double z_mm,
                                                            std::span<const Vec3> seeds, std::stop_token stop) {
  for (std::size_t k = 0; k < other_cursors_.size(); ++k) {
    const ScalarField& field = *setting_.other_kernels[k];
    MarchOptions options;
    // Contours are counted only.
    const double width = near_.points.empty() ? 1 : field.kernel_width_mm(near_.points.front());
    options.chord_mm = std::max(setting_.chord_mm, kCountingChordKernels * width);
    auto marched = march_contours(field, *other_cursors_[k], z_mm, seeds, {near_.points, near_.normals}, options, stop);
    if (!marched) return tl::unexpected{marched.error()};
    Candidate other;
    other.trace.contours = std::move(marched->contours);
    if (other.count() == candidate.count()) continue;
    return TraceFault{
        fmt::format(
            "a kernel of {:.3g} mm finds {} outer and {} hole contours, one of {:.3g} mm {} and {}: details here "
            "are as small as the scan is uncertain",
            setting_.field.kernel_width_mm(near_.points.front()), candidate.count().outers, candidate.count().holes,
            width, other.count().outers, other.count().holes),
        place_of_difference(candidate.trace.contours, other.trace.contours)};
  }
  return std::nullopt;
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

  std::vector<Vec3> seeds;
  if (setting_.topology)
    for (const ContourSeed& seed : setting_.topology->seeds(z_mm)) seeds.push_back(seed.point_mm);

  CutLayer result;
  std::optional<Candidate> march, grid;
  const Candidate* chosen = nullptr;
  bool certified = false;
  if (setting_.method != TraceMethod::Grid) {
    auto found = marched(z_mm, seeds, stop);
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
    } else if (!setting_.sparse && march && march->sound() && grid->sound() && march->count() == grid->count() &&
               (!predicted || near_critical || march->trace.euler() == *predicted)) {
      // Nothing is promised here, but two independent ways around the same field agree.
      certified = true;
    } else if (!march || !march->sound() || grid->sound()) {
      chosen = &*grid;
    }
  }

  std::optional<TraceFault> unsettled;
  // Of a noisy scan the other kernels tell more.
  if (setting_.topology && (setting_.sparse || setting_.other_kernels.empty()))
    if (const auto edge = setting_.topology->rounded_near(z_mm))
      unsettled = {"an edge sharper than the scan shows begins or ends near this height", {edge->x(), edge->y()}};
  if (certified && !unsettled) {
    auto found = disagreement(*chosen, z_mm, seeds, stop);
    if (!found) return tl::unexpected{found.error()};
    unsettled = std::move(*found);
  }

  Layer& layer = result.layer;
  layer.index = index;
  layer.z_mm = z_mm;
  LayerCertificate& certificate = layer.certificate;
  certificate.method = chosen->method;
  certificate.predicted_euler = predicted;
  certificate.measured_euler = chosen->trace.euler();
  const TraceFault* fault = chosen->sound() ? nullptr : &chosen->trace.faults[0];
  if (!fault && certified && unsettled) fault = &*unsettled;
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
