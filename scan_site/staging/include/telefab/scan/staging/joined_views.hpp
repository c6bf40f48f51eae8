// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::scan {

/// A view of an object: a range image, or a cloud.
struct ViewFile {
  std::string name;
  std::vector<std::byte> bytes;
};

/// Several views as one scan.
struct JoinedFile {
  std::vector<std::byte> ply;  ///< oriented cloud; millimetres where all views state a unit, else their own
  std::string facts_json;      ///< one object: views, rms, points, notes
};

/// Joins views in any order and pose, as `telefab-scan register` does without a step. At least two. Fails: InvalidInput
/// (a file, units that differ, views that do not fit together, by name), Cancelled.
[[nodiscard]] Result<JoinedFile> joined_views(const std::vector<ViewFile>& files, const ProgressSink& progress,
                                              std::stop_token stop);

}  // namespace telefab::scan
