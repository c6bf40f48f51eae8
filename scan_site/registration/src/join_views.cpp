// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/join_views.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

#include "pose_graph.hpp"

namespace telefab::scan {
namespace {

constexpr double kLeastShareJoined = 0.5;  ///< of the views; with fewer nobody can say which ones were meant

/// Turns the normals of single range images about if, all together, they face inward: every image of one scanner has
/// the same sense.
void face_outward(std::vector<RangeImage>& views, const std::vector<ViewSeries>& series) {
  double flux = 0;
  const auto may_be_turned = [&](const ViewSeries& s) {
    return s.views.size() == 1 && !views[s.views[0]].view.point_at.empty();
  };
  for (const ViewSeries& s : series) {
    if (!may_be_turned(s)) continue;
    const RangeImage& view = views[s.views[0]];
    Vec3 middle = Vec3::Zero();
    for (const auto& p : view.points) middle += p.cast<double>() / static_cast<double>(view.points.size());
    for (std::size_t i = 0; i < view.points.size(); ++i)
      flux += (view.points[i].cast<double>() - middle).dot(view.normals[i].cast<double>());
  }
  if (flux < 0)
    for (const ViewSeries& s : series)
      if (may_be_turned(s)) face_away(views[s.views[0]]);
}

/// The series that repeat another one point by point.
void mark_copies(std::span<const RangeImage> views, const std::vector<ViewSeries>& series,
                 std::vector<SeriesReport>& reports) {
  for (std::size_t b = 1; b < series.size(); ++b)
    for (std::size_t a = 0; a < b && reports[b].verdict != JoinVerdict::SameScan; ++a) {
      const bool is_copy = std::ranges::all_of(series[b].views, [&](std::size_t v) {
        return std::ranges::any_of(series[a].views, [&](std::size_t u) { return views[u].points == views[v].points; });
      });
      if (!is_copy) continue;
      reports[b].verdict = JoinVerdict::SameScan;
      reports[b].same_as = a;
    }
}

std::string list_of(const std::vector<double>& turns) {
  std::string text;
  for (std::size_t i = 0; i < turns.size(); ++i)
    text += fmt::format("{}{:.0f}", i == 0 ? "" : i + 1 == turns.size() ? " and " : ", ", turns[i]);
  return text;
}

/// Rounded to whole degrees, each once.
std::vector<double> distinct(std::vector<double> turns) {
  for (double& t : turns) t = std::round(t);
  std::sort(turns.begin(), turns.end());
  turns.erase(std::unique(turns.begin(), turns.end()), turns.end());
  return turns;
}

Result<void> refuse_if_too_few(const std::vector<SeriesReport>& reports) {
  std::size_t views = 0, joined = 0, bodies = 0;
  std::string reasons;
  bool lost_series = false;
  for (const SeriesReport& r : reports) {
    const bool is_copy = r.verdict == JoinVerdict::SameScan && r.views == 1;
    views += is_copy ? 0 : r.views;
    if (r.is_joined()) {
      joined += r.views;
      ++bodies;
      continue;
    }
    lost_series = lost_series || r.views > 1;
    reasons += fmt::format("{}{}", reasons.empty() ? "" : "; ", sentence_of(r, reports));
  }
  if (bodies > 1 && !lost_series && static_cast<double>(joined) > kLeastShareJoined * static_cast<double>(views))
    return {};
  return fail(ErrorCode::NotConverged, fmt::format("the scans do not join: {}", reasons));
}

}  // namespace

std::string_view name_of(JoinVerdict verdict) {
  switch (verdict) {
    case JoinVerdict::Fits:
      return "fits";
    case JoinVerdict::SameScan:
      return "same-scan";
    case JoinVerdict::NoPose:
      return "no-pose";
    case JoinVerdict::ThinOverlap:
      return "thin-overlap";
    case JoinVerdict::Misfit:
      return "misfit";
    case JoinVerdict::SeenThrough:
      return "seen-through";
    case JoinVerdict::Slides:
      return "slides";
    case JoinVerdict::Ambiguous:
      return "ambiguous";
  }
  return "";
}

Result<void> JoinOptions::validate() const {
  if (!(max_rms > 0)) return fail(ErrorCode::InvalidInput, "the error budget must be above 0");
  if (!(min_overlap > 0 && min_overlap <= 1))
    return fail(ErrorCode::InvalidInput, "min_overlap must be above 0 and at most 1");
  if (!(max_rms_ratio > 1)) return fail(ErrorCode::InvalidInput, "max_rms_ratio must be above 1");
  if (!(max_conflict >= 0 && max_conflict <= 1))
    return fail(ErrorCode::InvalidInput, "max_conflict must be within 0 and 1");
  if (!(min_stiffness >= 0 && min_stiffness <= 1.0 / 3))
    return fail(ErrorCode::InvalidInput, "min_stiffness must be within 0 and 1/3");
  return {};
}

Result<Joined> join_views(std::vector<RangeImage>& views, const std::vector<ViewSeries>& series,
                          const JoinOptions& options, const ProgressSink& progress, std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  if (series.size() < 2)
    return fail(ErrorCode::InvalidInput, fmt::format("{} scan given; at least 2 are needed to join", series.size()));
  face_outward(views, series);
  Joined result;
  for (const ViewSeries& s : series) result.series.push_back({.name = s.name, .views = s.views.size()});
  mark_copies(views, series, result.series);

  PoseGraph graph{views, series, result.series, options};
  if (auto found = graph.find_candidates(progress, stop); !found) return tl::unexpected{found.error()};
  if (auto grown = graph.join_best_first(stop); !grown) return tl::unexpected{grown.error()};
  for (;;) {
    if (auto enough = refuse_if_too_few(result.series); !enough) return tl::unexpected{enough.error()};
    std::vector<RangeImage> kept;
    result.kept.clear();
    std::vector<RigidMotion> start;
    for (const auto& [view, pose] : graph.poses()) {
      result.kept.push_back(view);
      kept.push_back(views[view]);
      start.push_back(pose);
    }
    auto adjusted = register_views(kept, {.start = std::move(start), .max_rms = options.max_rms}, progress, stop);
    if (!adjusted) return tl::unexpected{adjusted.error()};
    result.registration = std::move(*adjusted);
    // all together may say what two alone could not
    if (!graph.drop_what_misfits(result.registration.poses)) {
      result.noise = graph.noise().rms;
      result.noise_is_guessed = graph.has_guessed_noise();
      views = std::move(kept);
      return result;
    }
  }
}

std::string sentence_of(const SeriesReport& r, const std::vector<SeriesReport>& all) {
  switch (r.verdict) {
    case JoinVerdict::Fits:
      return fmt::format("{} fits", r.name);
    case JoinVerdict::SameScan:
      return fmt::format("{} is the same scan as {}", r.name, r.same_as ? all[*r.same_as].name : "another one");
    case JoinVerdict::NoPose:
      return fmt::format(
          "no pose of {} fits any other: it shows another object, or too little of the same; scan views "
          "in between that show both sides",
          r.name);
    case JoinVerdict::ThinOverlap:
      return fmt::format(
          "{} overlaps the others by {:.0f} % only at the best pose found: scan two more views that "
          "show both sides",
          r.name, 100 * r.overlap);
    case JoinVerdict::Misfit:
      return fmt::format(
          "{} fits to {:.3g} only where the scan's own noise is {:.3g} (its patches to {:.3g}, {:.3g}; "
          "overlap {:.0f} %): another object, a mirrored or bent one, or too little overlap to find its "
          "pose; scan views in between",
          r.name, r.rms, r.noise, r.patch_rms, r.patch_noise, 100 * r.overlap);
    case JoinVerdict::SeenThrough:
      return fmt::format(
          "at the best pose found {:.1f} % of the points of {} stand where other views saw through: it "
          "does not fit; scan views in between",
          100 * r.conflict.value_or(0), r.name);
    case JoinVerdict::Slides:
      return fmt::format(
          "{} may slide or turn on the others without a change (a body of revolution, or plain faces): "
          "scan views that show more shape, or put something with a shape beside it",
          r.name);
    case JoinVerdict::Ambiguous: {
      const std::vector<double> turns = distinct(r.equal_turns_deg);
      return fmt::format(
          "{} fits in {} ways that the scan cannot tell apart: turns of {} degrees; scan views that show "
          "the difference, or say --accept-symmetry if there is none",
          r.name, r.equal_turns_deg.size() + 1, list_of(turns));
    }
  }
  return "";
}

std::string to_json(const std::vector<SeriesReport>& series) {
  std::string text;
  for (const SeriesReport& r : series) {
    std::string turns;
    for (const double t : r.equal_turns_deg) turns += fmt::format("{}{:.2f}", turns.empty() ? "" : ",", t);
    text += fmt::format(
        R"({}{{"name":"{}","views":{},"joined":{},"verdict":"{}","same_as":{},"overlap":{:.4f},"rms":{:.6g},"patch_rms":{:.6g},"noise":{:.6g},"patch_noise":{:.6g},"conflict":{},"stiffness":{:.5f},"runner_up":{:.4f},"equal_turns_deg":[{}]}})",
        text.empty() ? "" : ",", r.name, r.views, r.is_joined(), name_of(r.verdict),
        r.same_as ? fmt::format("\"{}\"", series[*r.same_as].name) : "null", r.overlap, r.rms, r.patch_rms, r.noise,
        r.patch_noise, r.conflict ? fmt::format("{:.5f}", *r.conflict) : "null", r.stiffness, r.runner_up, turns);
  }
  return "[" + text + "]";
}

}  // namespace telefab::scan
