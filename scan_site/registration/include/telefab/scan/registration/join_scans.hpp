// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/scan/registration/join_views.hpp>
#include <vector>

namespace telefab::scan {

/// Scans that were given together: the views of one turn of the table, or views in any order.
struct ScanGroup {
  std::string name;
  std::size_t first = 0, count = 0;  ///< indices of its views
  double step_deg = 0;               ///< [0, 180]; turn from one view to the next; 0: not known, any order
};

struct JoinScansOptions {
  JoinOptions join;
  std::optional<Vec3> axis_direction;  ///< of every turn, see RegisterOptions
  bool keep_table = false;             ///< a table below a turned object stays
  std::optional<double> cut_below;     ///< removes what is lower than this in every turn: a stand; unit of the files
};

struct JoinedScans {
  Joined joined;
  std::optional<TurntableAxis> axis;  ///< of the first turn, frame of the result; unset: nothing was turned
  std::optional<Vec3> up;             ///< unit, along it, as the scanner of that turn stood
  std::vector<std::string> notes;     ///< what was left out, and what could not be tested; for people
  std::size_t table_points = 0;       ///< removed as table or stand
};

/// The whole way from scans of an object in several placements to one set of poses: every turn on its own, its table
/// off, then all of them joined. Erases views left out from `views`. Unit of the files.
/// Fails as register_views and join_views do, naming the group.
[[nodiscard]] Result<JoinedScans> join_scans(std::vector<RangeImage>& views, const std::vector<ScanGroup>& groups,
                                             const JoinScansOptions& options, const ProgressSink& progress,
                                             std::stop_token stop);

}  // namespace telefab::scan
