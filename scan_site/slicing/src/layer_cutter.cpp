// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_cutter.hpp"

#include <cmath>
#include <limits>
#include <telefab/scan/contour/layer_checks.hpp>
#include <telefab/scan/contour/reeb_marcher.hpp>

#include "coverage.hpp"

namespace telefab::scan {
namespace {

/// Samples flatter than this do not tell where, or whether, the surface meets the plane.
constexpr double kSteepNz = 0.8;
/// Walls this near below and above a plane, in kernel widths, must be cut by it.
constexpr double kWallKernels = 1.2;
/// Chord tolerance, in kernel widths, of contours that are only counted.
constexpr double kCountingChordKernels = 0.02;

using Verdict = LayerCertificate::Verdict;
using Method = LayerCertificate::Method;
using Ground = LayerCertificate::Ground;

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

/// Of two results that disagree: sound before unsound; but nothing never stands in the place of something. The grid,
/// which looks everywhere, before the march, which follows its seeds.
bool LayerCutter::better_founded(const Candidate& grid, const Candidate& march) {
  if (grid.trace.contours.empty() != march.trace.contours.empty()) return march.trace.contours.empty();
  return grid.sound() || !march.sound();
}

LayerCutter::LayerCutter(const CutSetting& setting) : setting_{setting}, cursor_{setting.field.cursor()} {
  for (const ScalarField* field : setting.other_kernels) other_cursors_.push_back(field->cursor());
}

void LayerCutter::judge(Candidate& candidate, double z_mm) {
  std::vector<Doubt>& faults = candidate.trace.faults;
  if (candidate.trace.contours.empty())
    if (const auto place = wall_through(z_mm)) faults.push_back({DoubtReason::ContourMissing, *place});
  const Coverage coverage = coverage_of(setting_.field, *cursor_, z_mm, candidate.trace.contours, steep_,
                                        setting_.cover_kernels, setting_.noise_mm);
  if (coverage.lost > 0)
    faults.push_back({DoubtReason::SurfaceUncovered, coverage.place, static_cast<std::uint32_t>(coverage.lost)});
  const auto most = static_cast<std::size_t>(setting_.stray_share * static_cast<double>(steep_.points.size()));
  if (coverage.unexplained > most)
    faults.push_back(
        {DoubtReason::SamplesOffSurface, coverage.place, static_cast<std::uint32_t>(coverage.unexplained)});
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
      candidate.trace.faults.push_back({DoubtReason::ContourOpen, problem.place});
  finish_trace(candidate.trace);
  judge(candidate, z_mm);
  return candidate;
}

Result<std::optional<Doubt>> LayerCutter::disagreement(const Candidate& candidate, double z_mm,
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
    return Doubt{.reason = DoubtReason::KernelsDisagree,
                 .place = place_of_difference(candidate.trace.contours, other.trace.contours),
                 .size_mm = near_.points.empty() ? 0 : setting_.field.kernel_width_mm(near_.points.front()),
                 .other_mm = width,
                 .found = candidate.count(),
                 .other = other.count()};
  }
  return std::nullopt;
}

Result<LayerCutter::Candidate> LayerCutter::gridded(double z_mm, std::stop_token stop) {
  GridOptions options;
  options.chord_mm = setting_.chord_mm;
  auto trace = trace_by_grid(setting_.field, *cursor_, z_mm, {near_.points, near_.normals}, options, stop);
  if (!trace) return tl::unexpected{trace.error()};
  if (!trace->gaps.empty() && setting_.closed) {
    trace = closed(*trace, z_mm, options, stop);
    if (!trace) return tl::unexpected{trace.error()};
  }
  Candidate candidate;
  candidate.trace = std::move(*trace);
  judge(candidate, z_mm);
  return candidate;
}

Result<LayerTrace> LayerCutter::closed(const LayerTrace& open, double z_mm, const GridOptions& options,
                                       std::stop_token stop) {
  if (!closed_cursor_) closed_cursor_ = setting_.closed->cursor();
  auto whole = trace_by_grid(*setting_.closed, *closed_cursor_, z_mm, {near_.points, near_.normals}, options, stop);
  if (!whole) return whole;
  whole->evaluations += open.evaluations;
  for (ContourGap gap : open.gaps) {
    gap.bridged = true;
    whole->faults.push_back({.reason = DoubtReason::GapBridged,
                             .place = gap.place,
                             .size_mm = std::isfinite(gap.size_mm) ? gap.size_mm : 0});
    whole->gaps.push_back(gap);
  }
  return whole;
}

Result<void> LayerCutter::classify(Layer& layer) const {
  if (!setting_.surface) return {};
  LayerCertificate& certificate = layer.certificate;
  for (Contour& contour : layer.contours) {
    auto with_runs_made = contour.with_runs(setting_.surface(contour, layer.z_mm));
    if (!with_runs_made) return fail(ErrorCode::Internal, with_runs_made.error().what);
    contour = std::move(*with_runs_made);
    std::size_t edge = 0;
    for (const SurfaceRun& run : contour.runs()) {
      if (run.kind == SurfaceClass::Completed && certificate.verdict == Verdict::Measured)
        certificate.verdict = Verdict::Completed;
      if (run.kind == SurfaceClass::Doubtful && certificate.is_certified())
        certificate.flag({DoubtReason::WindingDisagrees, contour.vertices()[edge], run.edges});
      edge += run.edges;
    }
  }
  return {};
}

std::optional<Point2> LayerCutter::wall_through(double z_mm) {
  // near_ rises in z.
  if (setting_.sparse && !near_.points.empty() && near_.points.front().z() < z_mm && near_.points.back().z() > z_mm)
    return Point2{near_.points.front().x(), near_.points.front().y()};
  if (!near_.points.empty() && straddles(setting_.field, *cursor_, z_mm, near_))
    return Point2{near_.points.front().x(), near_.points.front().y()};
  // A row of samples may be missing: walls farther away count, but no tops and undersides, between which may be air.
  const double reach = kWallKernels / setting_.band_kernels * setting_.band_mm;
  SurfaceSamples walls;
  setting_.samples(z_mm - reach, z_mm + reach, walls);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < walls.points.size(); ++i)
    if (std::abs(walls.normals[i].z()) <= kSteepNz) {
      walls.points[kept] = walls.points[i];
      walls.normals[kept++] = walls.normals[i];
    }
  walls.points.resize(kept);
  walls.normals.resize(kept);
  if (!straddles(setting_.field, *cursor_, z_mm, walls)) return std::nullopt;
  return Point2{walls.points.front().x(), walls.points.front().y()};
}

std::optional<Point2> LayerCutter::walls_of_next_rows(double z_mm) {
  const Box3 box = setting_.field.bounds();
  SurfaceSamples rows;
  for (double reach = setting_.band_mm; z_mm - reach > box.min.z() || z_mm + reach < box.max.z(); reach *= 2) {
    setting_.samples(z_mm - reach, z_mm + reach, rows);
    if (rows.points.empty() || rows.points.front().z() > z_mm || rows.points.back().z() < z_mm) continue;
    const Vec3* below = nullptr;
    for (std::size_t i = 0; i < rows.points.size(); ++i) {
      if (std::abs(rows.normals[i].z()) > kSteepNz) continue;
      if (rows.points[i].z() < z_mm) below = &rows.points[i];
      if (rows.points[i].z() >= z_mm && below) return Point2{below->x(), below->y()};
    }
    return std::nullopt;
  }
  return std::nullopt;
}

void LayerCutter::gather(double z_mm) {
  setting_.samples(z_mm - setting_.band_mm, z_mm + setting_.band_mm, near_);
  steep_.points.clear();
  steep_.normals.clear();
  steep_.in_gap.clear();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < near_.points.size(); ++i) {
    const Vec3 point = near_.points[i];
    const Vec3 normal = near_.normals[i];
    if (std::abs(point.z() - z_mm) > setting_.band_kernels * setting_.field.kernel_width_mm(point)) continue;
    near_.points[kept] = point;
    near_.normals[kept] = normal;
    if (!near_.in_gap.empty()) near_.in_gap[kept] = near_.in_gap[i];
    ++kept;
    if (std::abs(normal.z()) > kSteepNz) continue;
    steep_.points.push_back(point);
    steep_.normals.push_back(normal);
    if (!near_.in_gap.empty()) steep_.in_gap.push_back(near_.in_gap[i]);
  }
  near_.points.resize(kept);
  near_.normals.resize(kept);
  if (!near_.in_gap.empty()) near_.in_gap.resize(kept);
}

Result<CutLayer> LayerCutter::cut(LayerIndex index, double z_mm, std::stop_token stop) {
  if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled while cutting layers");
  gather(z_mm);

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
  Ground ground = Ground::None;
  if (setting_.method != TraceMethod::Grid) {
    auto found = marched(z_mm, seeds, stop);
    if (!found) return tl::unexpected{found.error()};
    march = std::move(*found);
    result.evaluations += march->trace.evaluations;
    chosen = &*march;
    certified = march->sound() && as_predicted(*march);
    if (certified) ground = Ground::Graph;
  }
  if (!certified && setting_.method != TraceMethod::Reeb) {
    auto found = gridded(z_mm, stop);
    if (!found) return tl::unexpected{found.error()};
    grid = std::move(*found);
    result.evaluations += grid->trace.evaluations;
    if (grid->sound() && as_predicted(*grid)) {
      chosen = &*grid;
      certified = true;
      ground = Ground::Graph;
    } else if (!setting_.sparse && march && march->sound() && grid->sound() && march->count() == grid->count() &&
               (!predicted || near_critical || march->trace.euler() == *predicted)) {
      // Nothing is promised here, but two independent ways around the same field agree.
      certified = true;
      ground = Ground::TwoMethods;
    } else if (!march || better_founded(*grid, *march)) {
      chosen = &*grid;
    }
  }

  std::optional<Doubt> objection;
  // Between rows of samples that the kernel does not span both methods find nothing, and so do the critical points.
  if (certified && chosen->trace.contours.empty())
    if (const auto place = walls_of_next_rows(z_mm)) objection = Doubt{DoubtReason::ContourMissing, *place};
  // Of a noisy scan the other kernels tell more.
  if (!objection && setting_.topology && (setting_.sparse || setting_.other_kernels.empty()))
    if (const auto edge = setting_.measured ? setting_.topology->rounded_near(z_mm, setting_.measured)
                                            : setting_.topology->rounded_near(z_mm))
      objection = {DoubtReason::EdgeTooSharp, Point2{edge->x(), edge->y()}};
  if (certified && !objection) {
    auto found = disagreement(*chosen, z_mm, seeds, stop);
    if (!found) return tl::unexpected{found.error()};
    objection = std::move(*found);
  }

  Layer& layer = result.layer;
  layer.index = index;
  layer.z_mm = z_mm;
  LayerCertificate& certificate = layer.certificate;
  certificate.method = chosen->method;
  certificate.ground = ground;
  certificate.predicted_euler = predicted;
  certificate.measured_euler = chosen->trace.euler();
  if (!chosen->sound()) {
    certificate.flag(chosen->trace.faults[0]);
  } else if (certified && objection) {
    certificate.flag(*objection);
  } else if (!certified) {
    Doubt doubt{.reason = DoubtReason::NotCrossChecked};
    if (predicted && !near_critical)
      doubt.reason = DoubtReason::EulerDiffers;
    else if (march && grid)
      doubt = {.reason = DoubtReason::MethodsDisagree, .found = march->count(), .other = grid->count()};
    if (!chosen->trace.contours.empty()) doubt.place = chosen->trace.contours[0].vertices()[0];
    certificate.flag(doubt);
  } else {
    certificate.verdict = Verdict::Measured;
  }
  LayerTrace& taken = (chosen == (march ? &*march : nullptr) ? march : grid)->trace;
  layer.contours = std::move(taken.contours);
  result.gaps = std::move(taken.gaps);
  if (auto ok = classify(layer); !ok) return tl::unexpected{ok.error()};
  return result;
}

}  // namespace telefab::scan
