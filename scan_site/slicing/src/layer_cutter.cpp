// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_cutter.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <telefab/scan/contour/layer_checks.hpp>

#include "coverage.hpp"

namespace telefab::scan {
namespace {

/// Samples flatter than this do not tell where, or whether, the surface meets the plane.
constexpr double kSteepNz = 0.8;
/// Walls this near below and above a plane, in kernel widths, must be cut by it.
constexpr double kWallKernels = 1.2;
/// A march may ask the field so often, however few samples are near.
constexpr std::uint64_t kLeastEvaluations = 20'000;
/// Chord tolerance, in kernel widths, of contours that are only counted.
constexpr double kCountingChordKernels = 0.02;

using Verdict = LayerCertificate::Verdict;
using Method = LayerCertificate::Method;
using Ground = LayerCertificate::Ground;

}  // namespace

struct LayerCutter::Candidate {
  Method method = Method::Grid;
  LayerTrace trace;
  std::size_t beside_graph = 0;  ///< contours that only a sample led to
  DoubtfulPlaces where;          ///< of the faults

  [[nodiscard]] bool sound() const { return trace.faults.empty(); }
  [[nodiscard]] ContourCount count() const {
    ContourCount c;
    for (const Contour& ring : trace.contours) ++(ring.is_hole() ? c.holes : c.outers);
    return c;
  }
};

/// What the critical points tell of a plane.
struct LayerCutter::Prediction {
  std::optional<int> euler;
  std::optional<ContourCount> count;
  bool counted = false;  ///< by a slice at another height: two methods that agree here know better
  bool near_critical = true;
  std::vector<Vec3> seeds;
};

/// What was found, which of it is taken, and what vouches for that.
struct LayerCutter::Choice {
  std::optional<Candidate> march, grid;
  bool takes_grid = false;
  Ground ground = Ground::None;
  std::optional<Point2> contradicted;  ///< where the winding number does not bear it out

  [[nodiscard]] bool certified() const { return ground != Ground::None; }
  [[nodiscard]] Candidate& chosen() { return takes_grid ? *grid : *march; }
  [[nodiscard]] const Candidate& chosen() const { return takes_grid ? *grid : *march; }
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
  const Coverage coverage =
      coverage_of(setting_.field, *cursor_, z_mm, candidate.trace.contours, steep_, setting_.cover_kernels,
                  setting_.noise_mm, setting_.sparse ? nullptr : setting_.samples);
  const auto place = [&] { return coverage.places.front(); };
  if (coverage.lost > 0)
    faults.push_back({DoubtReason::SurfaceUncovered, place(), static_cast<std::uint32_t>(coverage.lost)});
  const auto most = static_cast<std::size_t>(setting_.stray_share * static_cast<double>(steep_.points.size()));
  if (coverage.unexplained > most) {
    faults.push_back({DoubtReason::SamplesOffSurface, place(), static_cast<std::uint32_t>(coverage.unexplained)});
    for (const Point2& p : coverage.places) candidate.where.add(p, width_at(p, z_mm));
  }
  for (const ContourGap& gap : candidate.trace.gaps)
    candidate.where.add(gap.place, width_at(gap.place, z_mm) + (std::isfinite(gap.size_mm) ? gap.size_mm : 0));
  for (const Doubt& fault : faults) switch (fault.reason) {
      case DoubtReason::SamplesOffSurface:
      case DoubtReason::GapBridged:
        break;
      case DoubtReason::ContoursCross:
        candidate.where.add(*fault.place, width_at(*fault.place, z_mm));
        break;
      default:  // something is missing, or nothing fits
        candidate.where.add_all();
    }
}

MarchOptions LayerCutter::march_options() const {
  MarchOptions options;
  options.chord_mm = setting_.chord_mm;
  options.most_evaluations = kLeastEvaluations + setting_.evaluations_a_sample * near_.points.size();
  return options;
}

Result<LayerCutter::Candidate> LayerCutter::marched(double z_mm, std::span<const Vec3> seeds, std::stop_token stop) {
  const MarchOptions options = march_options();
  auto marched = march_contours(setting_.field, *cursor_, z_mm, seeds, {near_.points, near_.normals}, options, stop);
  if (!marched) return tl::unexpected{marched.error()};
  Candidate candidate;
  candidate.method = Method::Reeb;
  candidate.beside_graph = marched->from_coverage;
  candidate.trace.contours = std::move(marched->contours);
  candidate.trace.evaluations = marched->evaluations;
  for (const MarchProblem& problem : marched->problems)
    if (problem.kind == MarchProblem::Kind::Open || problem.kind == MarchProblem::Kind::TooLong)
      candidate.trace.faults.push_back({DoubtReason::ContourOpen, problem.place});
  finish_trace(candidate.trace);
  judge(candidate, z_mm);
  return candidate;
}

Result<std::optional<Doubt>> LayerCutter::disagreement(const Candidate& candidate, double z_mm,
                                                       std::span<const Vec3> seeds, std::stop_token stop,
                                                       DoubtfulPlaces& where) {
  for (std::size_t k = 0; k < other_cursors_.size(); ++k) {
    const ScalarField& field = *setting_.other_kernels[k];
    MarchOptions options = march_options();
    // Contours are counted only.
    const double width = near_.points.empty() ? 1 : field.kernel_width_mm(near_.points.front());
    options.chord_mm = std::max(setting_.chord_mm, kCountingChordKernels * width);
    auto marched = march_contours(field, *other_cursors_[k], z_mm, seeds, {near_.points, near_.normals}, options, stop);
    if (!marched) return tl::unexpected{marched.error()};
    Candidate other;
    other.trace.contours = std::move(marched->contours);
    if (other.count() == candidate.count()) continue;
    return Doubt{.reason = DoubtReason::KernelsDisagree,
                 .place = where.add_difference(candidate.trace.contours, other.trace.contours, width),
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

bool LayerCutter::lacks_all(const Candidate& candidate) {
  const auto missing = [](const Doubt& d) { return d.reason == DoubtReason::ContourMissing; };
  return candidate.trace.contours.empty() &&
         std::any_of(candidate.trace.faults.begin(), candidate.trace.faults.end(), missing);
}

Result<std::optional<LayerCutter::Candidate>> LayerCutter::from_last_resort(double z_mm, std::stop_token stop) {
  GridOptions options;
  options.chord_mm = setting_.chord_mm;
  const auto cursor = setting_.last_resort->cursor();
  auto trace = trace_by_grid(*setting_.last_resort, *cursor, z_mm, {near_.points, near_.normals}, options, stop);
  if (!trace) return tl::unexpected{trace.error()};
  if (trace->contours.empty()) return std::nullopt;
  Candidate candidate;
  candidate.trace = std::move(*trace);
  candidate.trace.faults.insert(candidate.trace.faults.begin(),
                                {.reason = DoubtReason::GapBridged,
                                 .place = candidate.trace.contours[0].vertices()[0],
                                 .size_mm = width_at(candidate.trace.contours[0].vertices()[0], z_mm)});
  candidate.where.add_all();
  return candidate;
}

Result<void> LayerCutter::classify(Layer& layer, const DoubtfulPlaces& where) const {
  LayerCertificate& certificate = layer.certificate;
  for (Contour& contour : layer.contours) {
    if (setting_.surface) {
      auto classified = contour.with_runs(setting_.surface(contour, layer.z_mm));
      if (!classified) return fail(ErrorCode::Internal, classified.error().what);
      contour = std::move(*classified);
    }
    std::size_t edge = 0;
    for (const SurfaceRun& run : contour.runs()) {
      if (run.kind == SurfaceClass::Completed && certificate.verdict == Verdict::Measured)
        certificate.verdict = Verdict::Completed;
      if (run.kind == SurfaceClass::Doubtful && certificate.is_certified())
        certificate.flag({DoubtReason::WindingDisagrees, contour.vertices()[edge], run.edges});
      edge += run.edges;
    }
  }
  if (setting_.known_doubt && certificate.is_certified()) {
    certificate.flag(*setting_.known_doubt);
    DoubtfulPlaces all;
    all.add_all();
    return all.mark(layer);
  }
  return where.mark(layer);
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

LayerCutter::Prediction LayerCutter::prediction_at(double z_mm) const {
  Prediction p;
  if (!setting_.topology) return p;
  p.euler = setting_.topology->predicted_euler(z_mm);
  p.counted = setting_.topology->rests_on_a_count(z_mm);
  p.count = setting_.topology->predicted_contours(z_mm);
  p.near_critical = setting_.topology->is_near_critical(z_mm);
  for (const ContourSeed& seed : setting_.topology->seeds(z_mm)) p.seeds.push_back(seed.point_mm);
  return p;
}

Result<LayerCutter::Choice> LayerCutter::choose(double z_mm, const Prediction& predicted, std::stop_token stop) {
  const auto as_predicted = [&](const Candidate& c) {
    return predicted.euler && !predicted.near_critical && c.trace.euler() == *predicted.euler &&
           (!predicted.count || c.count() == *predicted.count);
  };
  Choice made;
  if (setting_.method != TraceMethod::Grid) {
    auto found = marched(z_mm, predicted.seeds, stop);
    if (!found) return tl::unexpected{found.error()};
    made.march = std::move(*found);
    if (made.march->sound() && as_predicted(*made.march)) made.ground = Ground::Graph;
    if (made.ground == Ground::Graph || setting_.method == TraceMethod::Reeb) return made;
  }
  auto found = gridded(z_mm, stop);
  if (!found) return tl::unexpected{found.error()};
  made.grid = std::move(*found);
  const Candidate& grid = *made.grid;
  const bool march_is_sound = made.march && made.march->sound();
  if (grid.sound() && as_predicted(grid)) {
    made.takes_grid = true;
    made.ground = Ground::Graph;
  } else if (!grid.sound() || (march_is_sound && !(made.march->count() == grid.count()))) {
    made.takes_grid = !made.march || better_founded(grid, *made.march);
  } else {
    // Nothing is promised here. Two independent ways around the same field may agree; and where the graph is wrong
    // about some height below, or the march got lost, the grid may have the winding number for it.
    made.takes_grid = !march_is_sound;
    if (!setting_.sparse && march_is_sound &&
        (!predicted.euler || predicted.near_critical || predicted.counted ||
         made.march->trace.euler() == *predicted.euler))
      made.ground = Ground::TwoMethods;
    else if (!predicted.near_critical && setting_.contradiction)
      if (made.contradicted = setting_.contradiction(grid.trace.contours, z_mm, near_); !made.contradicted)
        made.ground = Ground::WindingTest;
  }
  return made;
}

Result<std::optional<Doubt>> LayerCutter::unsettled(const Choice& made, double z_mm, std::span<const Vec3> seeds,
                                                    std::stop_token stop, DoubtfulPlaces& where) {
  std::optional<Doubt> doubt;
  const auto note = [&](const Doubt& found, double reach_mm) {
    where.add(*found.place, std::max(reach_mm, width_at(*found.place, z_mm)));
    if (!doubt) doubt = found;
  };
  const auto place_of = [](const Vec3& p) { return Point2{p.x(), p.y()}; };
  // Between rows of samples that the kernel does not span both methods find nothing, and so do the critical points.
  if (made.certified() && made.chosen().trace.contours.empty())
    if (const auto place = walls_of_next_rows(z_mm)) note({DoubtReason::ContourMissing, *place}, 0);
  // Of a noisy scan the other kernels tell more.
  if (!doubt && setting_.topology && (setting_.sparse || setting_.other_kernels.empty()))
    if (const auto edge = setting_.measured ? setting_.topology->rounded_near(z_mm, setting_.measured)
                                            : setting_.topology->rounded_near(z_mm))
      note({DoubtReason::EdgeTooSharp, place_of(*edge)}, 0);
  for (const CutSetting::UndecidedPlace& u : setting_.undecided)
    if (u.low_mm.z() <= z_mm && z_mm <= u.high_mm.z()) {
      const double rise = u.high_mm.z() - u.low_mm.z();
      const Vec3 at = u.low_mm + (rise > 0 ? (z_mm - u.low_mm.z()) / rise : 0) * (u.high_mm - u.low_mm);
      note({.reason = DoubtReason::CriticalInGap, .place = place_of(at), .size_mm = u.reach_mm}, u.reach_mm);
    }
  if (const auto doubled = doubled_sheets(made, z_mm, where); doubled && !doubt) doubt = doubled;
  if (doubt || !made.certified()) return doubt;
  return disagreement(made.chosen(), z_mm, seeds, stop, where);
}

std::optional<Doubt> LayerCutter::doubled_sheets(const Choice& made, double z_mm, DoubtfulPlaces& where) const {
  const double reach = setting_.doubled_reach_mm;
  const auto from = std::partition_point(setting_.doubled.begin(), setting_.doubled.end(),
                                         [&](const DoubledPlace& p) { return p.at_mm.z() < z_mm - reach; });
  const auto until = std::partition_point(from, setting_.doubled.end(),
                                          [&](const DoubledPlace& p) { return p.at_mm.z() <= z_mm + reach; });
  std::vector<Point2> places;
  for (auto p = from; p != until; ++p) places.push_back({p->at_mm.x(), p->at_mm.y()});
  const std::vector<bool> beside = where.add_beside(made.chosen().trace.contours, places, reach);
  const DoubledPlace* farthest = nullptr;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const DoubledPlace& place = *(from + static_cast<std::ptrdiff_t>(i));
    if (beside[i] && (!farthest || place.apart_mm > farthest->apart_mm)) farthest = &place;
  }
  if (!farthest) return std::nullopt;
  return Doubt{.reason = DoubtReason::SheetsDoubled,
               .place = Point2{farthest->at_mm.x(), farthest->at_mm.y()},
               .size_mm = farthest->apart_mm};
}

Doubt LayerCutter::why_uncertified(const Choice& made, const Prediction& predicted, double z_mm,
                                   DoubtfulPlaces& where) const {
  const Candidate& chosen = made.chosen();
  Doubt doubt{.reason = DoubtReason::NotCrossChecked};
  if (made.march && made.grid && !(made.march->count() == made.grid->count())) {
    doubt = {.reason = DoubtReason::MethodsDisagree, .found = made.march->count(), .other = made.grid->count()};
    const Candidate& other = made.takes_grid ? *made.march : *made.grid;
    // One that got lost says itself where.
    for (const Doubt& fault : other.trace.faults)
      if (fault.place) {
        if (!doubt.place) doubt.place = fault.place;
        where.add(*fault.place, width_at(*fault.place, z_mm));
      }
    if (!doubt.place) {
      const double width = near_.points.empty() ? 0 : setting_.field.kernel_width_mm(near_.points.front());
      doubt.place = where.add_difference(chosen.trace.contours, other.trace.contours, width);
    }
  } else if (predicted.euler && !predicted.near_critical) {
    doubt.reason = DoubtReason::EulerDiffers;
  } else if (made.march && made.grid) {
    doubt = {.reason = DoubtReason::MethodsDisagree, .found = made.march->count(), .other = made.grid->count()};
  }
  if (made.contradicted) {
    doubt.place = made.contradicted;
    where.add(*made.contradicted, width_at(*made.contradicted, z_mm));
  }
  if (!doubt.place) {
    where.add_all();
    if (!chosen.trace.contours.empty()) doubt.place = chosen.trace.contours[0].vertices()[0];
  }
  return doubt;
}

Result<CutLayer> LayerCutter::cut(LayerIndex index, double z_mm, std::stop_token stop) {
  if (stop.stop_requested()) return cancelled("cutting layers");
  gather(z_mm);
  const Prediction predicted = prediction_at(z_mm);
  auto made = choose(z_mm, predicted, stop);
  if (!made) return tl::unexpected{made.error()};
  if (setting_.last_resort && lacks_all(made->chosen())) {
    auto found = from_last_resort(z_mm, stop);
    if (!found) return tl::unexpected{found.error()};
    if (*found) {
      made->grid = std::move(**found);
      made->takes_grid = true;
    }
  }
  DoubtfulPlaces where;
  const auto open_question = unsettled(*made, z_mm, predicted.seeds, stop, where);
  if (!open_question) return tl::unexpected{open_question.error()};

  CutLayer result;
  Layer& layer = result.layer;
  layer.index = index;
  layer.z_mm = z_mm;
  Candidate& chosen = made->chosen();
  LayerCertificate& certificate = layer.certificate;
  certificate.method = chosen.method;
  certificate.ground = made->ground;
  certificate.predicted_euler = predicted.euler;
  certificate.measured_euler = chosen.trace.euler();
  if (!chosen.sound()) {
    certificate.flag(chosen.trace.faults[0]);
    where = chosen.where;
  } else if (!made->certified()) {
    certificate.flag(why_uncertified(*made, predicted, z_mm, where));
  } else if (*open_question) {
    certificate.flag(**open_question);
  } else {
    certificate.verdict = Verdict::Measured;
  }
  for (const auto& candidate : {std::cref(made->march), std::cref(made->grid)})
    if (candidate.get()) result.evaluations += candidate.get()->trace.evaluations;
  layer.contours = std::move(chosen.trace.contours);
  result.gaps = std::move(chosen.trace.gaps);
  if (auto ok = classify(layer, where); !ok) return tl::unexpected{ok.error()};
  return result;
}

}  // namespace telefab::scan
