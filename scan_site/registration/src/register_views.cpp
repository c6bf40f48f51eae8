// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/register_views.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "adjust.hpp"
#include "turntable.hpp"

namespace telefab::scan {
namespace {

constexpr double kWidestLinkDeg = 100;  ///< views turned farther apart see hardly anything in common
constexpr double kOverlapReach = 3;     ///< in spacings: how near counts as the same surface

double turn_between(std::size_t a, std::size_t b, double step_deg) {
  const double turn = std::fmod(std::abs(static_cast<double>(a) - static_cast<double>(b)) * step_deg, 360);
  return std::min(turn, 360 - turn);
}

double overlap_of(const RangeImage& from, const AlignTarget& target, const RigidMotion& from_pose,
                  const RigidMotion& to_pose, double reach) {
  const std::size_t step = std::max<std::size_t>(1, from.points.size() / 1500);
  const auto matches = find_matches(from.points, from.normals, {}, from_pose, target, {}, to_pose, reach, step);
  const std::size_t sampled = (from.points.size() + step - 1) / step;
  std::size_t near = 0;
  for (const Match& m : matches) near += (m.source - m.target).norm() < reach ? 1 : 0;
  return static_cast<double>(near) / static_cast<double>(sampled);
}

/// True if the normals of all views together enclose a negative volume.
bool faces_inward(std::span<const RangeImage> views, std::span<const RigidMotion> poses) {
  Vec3 middle = Vec3::Zero();
  for (std::size_t i = 0; i < views.size(); ++i)
    for (const auto& p : views[i].points)
      middle += poses[i] * p.cast<double>() / static_cast<double>(views[i].points.size() * views.size());
  double flux = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t k = 0; k < views[i].points.size(); ++k)
      flux += (poses[i] * views[i].points[k].cast<double>() - middle)
                  .dot(poses[i].rotation() * views[i].normals[k].cast<double>());
  return flux < 0;
}

/// Refuses a chain of views that the links do not hold together.
Result<void> check_connected(std::span<const RangeImage> views, std::span<const LinkReport> links, double min_overlap) {
  std::vector<std::size_t> group(views.size());
  for (std::size_t i = 0; i < group.size(); ++i) group[i] = i;
  for (const LinkReport& l : links) {
    if (l.overlap < min_overlap) continue;
    const std::size_t a = group[l.from], b = group[l.to];
    for (std::size_t& g : group)
      if (g == b) g = a;
  }
  for (std::size_t i = 1; i < views.size(); ++i)
    if (group[i] != group[0])
      return fail(ErrorCode::NotConverged,
                  fmt::format("{} overlaps no other view by {:.0f} % or more; take more views, or smaller steps",
                              views[i].name, 100 * min_overlap));
  return {};
}

}  // namespace

Result<void> RegisterOptions::validate(std::size_t views) const {
  if (views < 2)
    return fail(ErrorCode::InvalidInput, fmt::format("{} range image given; at least 2 are needed", views));
  if (start.empty() && !(step_deg > 0 && step_deg <= 180))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a step of {} degrees; above 0 and up to 180 is possible", step_deg));
  if (!start.empty() && start.size() != views)
    return fail(ErrorCode::InvalidInput, fmt::format("{} poses for {} views", start.size(), views));
  if (!(max_rms > 0)) return fail(ErrorCode::InvalidInput, "the error budget must be above 0");
  if (!(min_overlap > 0 && min_overlap <= 1))
    return fail(ErrorCode::InvalidInput, "min_overlap must be above 0 and at most 1");
  if (!(max_conflict >= 0 && max_conflict <= 1))
    return fail(ErrorCode::InvalidInput, "max_conflict must be within 0 and 1");
  if (samples < 100) return fail(ErrorCode::InvalidInput, "at least 100 samples a view are needed");
  if (axis_direction && !(axis_direction->norm() > 0))
    return fail(ErrorCode::InvalidInput, "the axis has no direction");
  return {};
}

Result<Registration> register_views(std::span<RangeImage> views, const RegisterOptions& options,
                                    const ProgressSink& progress, std::stop_token stop) {
  if (auto valid = options.validate(views.size()); !valid) return tl::unexpected{valid.error()};
  std::vector<AlignTarget> targets;
  targets.reserve(views.size());
  double spacing = 0;
  for (const RangeImage& v : views) {
    targets.emplace_back(v.points, v.normals);
    spacing = std::max(spacing, static_cast<double>(v.spacing));
  }
  Registration result;
  const double whole_turn = options.step_deg * static_cast<double>(views.size());
  result.closed_turn = options.step_deg > 0 && std::abs(whole_turn - 360) < 0.5 * options.step_deg;

  report(progress, WorkStage::FindingAxis, 0);
  if (options.start.empty()) {
    const auto axis = find_axis(views, targets, result.closed_turn, options, stop);
    if (!axis) return tl::unexpected{axis.error()};
    result.axis = axis->axis;
    result.axis_score = axis->score;
    const RigidMotion step = step_motion(axis->axis, options.step_deg * std::numbers::pi / 180);
    result.poses.assign(views.size(), RigidMotion::Identity());
    for (std::size_t i = 1; i < views.size(); ++i) result.poses[i] = result.poses[i - 1] * step;
  } else {
    const RigidMotion first = options.start.front().inverse();
    for (const RigidMotion& p : options.start) result.poses.push_back(first * p);
  }

  // Links: every pair of views that sees enough in common.
  report(progress, WorkStage::AligningPairs, 0.3);
  std::vector<Link> links;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = 0; j < views.size(); ++j) {
      if (i == j || (options.step_deg > 0 && turn_between(i, j, options.step_deg) > kWidestLinkDeg)) continue;
      if (overlap_of(views[i], targets[j], result.poses[i], result.poses[j], 2 * kOverlapReach * spacing) >=
          options.min_overlap)
        links.push_back({i, j});
    }
  if (stop.stop_requested()) return cancelled("aligning pairs");
  std::vector<RigidMotion> pairwise;
  for (const Link& l : links) {
    LinkReport row{.from = l.from, .to = l.to};
    const RigidMotion start = result.poses[l.to].inverse() * result.poses[l.from];
    const auto alone = align(
        views[l.from].points, views[l.from].normals, targets[l.to], start,
        {.first_distance = 6 * spacing, .last_distance = kOverlapReach * spacing, .max_rounds = 25, .samples = 1500},
        stop);
    if (!alone && alone.error().code == ErrorCode::Cancelled) return tl::unexpected{alone.error()};
    pairwise.push_back(alone ? alone->motion : start);
    row.pair_rms = alone ? alone->rms : 0;
    result.links.push_back(row);
  }

  report(progress, WorkStage::AdjustingPoses, 0.6);
  const auto matches =
      adjust_all(views, targets, links,
                 {.first_reach = 8 * spacing, .last_reach = kOverlapReach * spacing, .samples = options.samples},
                 result.poses, stop);
  if (!matches) return tl::unexpected{matches.error()};

  // Figures.
  double square = 0, weight = 0;
  std::vector<double> offsets;
  Vec3 middle = Vec3::Zero();
  for (const auto& p : views[0].points) middle += p.cast<double>() / static_cast<double>(views[0].points.size());
  for (std::size_t l = 0; l < links.size(); ++l) {
    LinkReport& row = result.links[l];
    row.rms = rms_of((*matches)[l]);
    row.overlap = overlap_of(views[links[l].from], targets[links[l].to], result.poses[links[l].from],
                             result.poses[links[l].to], kOverlapReach * spacing);
    row.pair_to_global =
        difference(pairwise[l], result.poses[links[l].to].inverse() * result.poses[links[l].from], middle);
    for (const Match& m : (*matches)[l]) {
      square += m.weight * m.offset() * m.offset();
      weight += m.weight;
      offsets.push_back(std::abs(m.offset()));
    }
  }
  result.rms = weight > 0 ? std::sqrt(square / weight) : 0;
  const auto half = offsets.begin() + static_cast<std::ptrdiff_t>(offsets.size() / 2);
  std::nth_element(offsets.begin(), half, offsets.end());
  result.median_offset = *half;
  if (result.closed_turn) {
    RigidMotion round = RigidMotion::Identity();
    bool has_all = true;
    for (std::size_t i = 1; i <= views.size(); ++i) {
      const std::size_t from = i % views.size(), to = i - 1;
      const auto found =
          std::find_if(links.begin(), links.end(), [&](const Link& l) { return l.from == from && l.to == to; });
      has_all &= found != links.end();
      if (found != links.end()) round = round * pairwise[static_cast<std::size_t>(found - links.begin())];
    }
    if (has_all) result.closure = difference(round, RigidMotion::Identity(), middle);
  }
  report(progress, WorkStage::JudgingPoses, 0.9);
  if (auto held = check_connected(views, result.links, options.min_overlap); !held) return tl::unexpected{held.error()};
  if (result.rms > options.max_rms)
    return fail(ErrorCode::NotConverged,
                fmt::format("the views fit to {:.4g} only (point to plane, rms); the budget is {:.4g}", result.rms,
                            options.max_rms));
  if (faces_inward(views, result.poses))
    for (RangeImage& v : views) face_away(v);
  result.conflict = conflict_share(views, result.poses, 5 * spacing).value_or(0);
  if (result.conflict > options.max_conflict)
    return fail(ErrorCode::NotConverged, fmt::format("{:.1f} % of the points stand where another view saw through them "
                                                     "({:.1f} % are allowed): the views do not fit together",
                                                     100 * result.conflict, 100 * options.max_conflict));
  return result;
}

}  // namespace telefab::scan
