// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/join_scans.hpp>

#include <fmt/format.h>
#include <algorithm>

#include "table.hpp"

namespace telefab::scan {
namespace {

struct TurnFound {
  std::size_t first_view = 0;
  TurntableAxis axis;  ///< frame of that view
};

Result<void> check_left(std::span<const RangeImage> views, const ScanGroup& group) {
  const auto emptied = std::ranges::find_if(views, [](const RangeImage& v) { return v.points.size() < 100; });
  if (emptied == views.end()) return {};
  return fail(ErrorCode::InvalidInput, fmt::format("{}: {} has only {} points left without table and stand", group.name,
                                                   emptied->name, emptied->points.size()));
}

/// The poses of one turn; takes its table and stand out of the views.
Result<Registration> register_turn(std::span<RangeImage> views, const ScanGroup& group, const JoinScansOptions& options,
                                   JoinedScans& result, const ProgressSink& progress, const std::stop_token& stop) {
  std::optional<Vec3> axis = options.axis_direction;
  if (!options.keep_table)
    if (const auto table = remove_table(views, stop)) {
      result.table_points += table->points;
      result.notes.push_back(fmt::format(
          "{}: {} points of the table it stands on are left out (--keep-table keeps them)", group.name, table->points));
      if (!axis) axis = table->up;
    }
  if (auto enough = check_left(views, group); !enough) return tl::unexpected{enough.error()};
  auto turn = register_views(
      views, {.step_deg = group.step_deg, .axis_direction = axis, .max_rms = options.join.max_rms}, progress, stop);
  if (!turn) return fail_in(group.name, turn.error());
  if (options.cut_below) {
    const std::size_t removed = cut_below(views, *turn, up_of(turn->axis), *options.cut_below);
    result.table_points += removed;
    result.notes.push_back(fmt::format("{}: {} points of the stand are left out", group.name, removed));
  }
  if (auto enough = check_left(views, group); !enough) return tl::unexpected{enough.error()};
  return turn;
}

}  // namespace

Result<JoinedScans> join_scans(std::vector<RangeImage>& views, const std::vector<ScanGroup>& groups,
                               const JoinScansOptions& options, const ProgressSink& progress, std::stop_token stop) {
  JoinedScans result;
  std::vector<ViewSeries> series;
  std::optional<TurnFound> first_turn;
  for (const ScanGroup& group : groups) {
    if (group.step_deg > 0 && group.count > 1) {
      const auto turn =
          register_turn(std::span{views}.subspan(group.first, group.count), group, options, result, progress, stop);
      if (!turn) return tl::unexpected{turn.error()};
      ViewSeries whole{group.name, {}, turn->poses};
      for (std::size_t i = 0; i < group.count; ++i) whole.views.push_back(group.first + i);
      series.push_back(std::move(whole));
      if (!first_turn) first_turn = TurnFound{group.first, turn->axis};
      continue;
    }
    for (std::size_t i = group.first; i < group.first + group.count; ++i)
      series.push_back({views[i].name, {i}, {RigidMotion::Identity()}});
  }
  if (options.cut_below && !first_turn)
    return fail(ErrorCode::InvalidInput, "a stand is cut along the axis of a turn, and no turn was given");
  auto joined = join_views(views, series, options.join, progress, stop);
  if (!joined) return tl::unexpected{joined.error()};
  result.joined = std::move(*joined);
  const Joined& all = result.joined;
  if (first_turn) {
    const auto at = std::ranges::find(all.kept, first_turn->first_view);
    const RigidMotion& pose = all.registration.poses[static_cast<std::size_t>(at - all.kept.begin())];
    result.axis = TurntableAxis{pose.rotation() * first_turn->axis.direction, pose * first_turn->axis.point};
    result.up = pose.rotation() * up_of(first_turn->axis);
  }
  for (const SeriesReport& r : all.series) {
    if (!r.is_joined()) result.notes.push_back(sentence_of(r, all.series) + "; it is left out");
    if (r.is_joined() && !r.equal_turns_deg.empty())
      result.notes.push_back(fmt::format("{} fits in {} ways that give the same body; one of them is taken", r.name,
                                         r.equal_turns_deg.size() + 1));
  }
  if (all.noise_is_guessed)
    result.notes.push_back(
        "the noise of the scan is guessed, no turn and no third view tells it: a copy that is mirrored or bent by "
        "little "
        "more may pass; look at the picture, or scan more views");
  const bool untested =
      std::ranges::any_of(all.series, [](const SeriesReport& r) { return r.is_joined() && !r.conflict; });
  if (untested)
    result.notes.push_back(
        "free space not tested for all: clouds and views through a lens do not say what they saw through; rms, overlap "
        "and stiffness alone judge them");
  return result;
}

}  // namespace telefab::scan
