// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <telefab/geometry/limits.hpp>
#include <telefab/geometry/surface_run.hpp>

namespace telefab {

std::string_view name_of(SurfaceClass kind) {
  switch (kind) {
    case SurfaceClass::Measured:
      return "measured";
    case SurfaceClass::Completed:
      return "completed";
    case SurfaceClass::Doubtful:
      return "doubtful";
  }
  return "unknown";
}

std::vector<SurfaceRun> merged(std::span<const SurfaceRun> runs) {
  std::vector<SurfaceRun> made;
  for (const SurfaceRun& run : runs) {
    if (made.empty() || made.back().kind != run.kind) {
      made.push_back(run);
      continue;
    }
    SurfaceRun& last = made.back();
    last.edges += run.edges;
    last.gap_mm = std::max(last.gap_mm, run.gap_mm);
    last.error_mm = std::max(last.error_mm, run.error_mm);
  }
  if (made.size() == 1 && made[0].kind == SurfaceClass::Measured) made.clear();
  return made;
}

std::vector<SurfaceRun> one_an_edge(std::span<const SurfaceRun> runs, std::size_t edges) {
  std::vector<SurfaceRun> made;
  made.reserve(edges);
  for (const SurfaceRun& run : runs) made.insert(made.end(), run.edges, {run.kind, 1, run.gap_mm, run.error_mm});
  if (runs.empty()) made.resize(edges);
  return made;
}

Result<void> validate_runs(std::span<const SurfaceRun> runs, std::size_t edges) {
  if (runs.empty()) return {};
  const auto length = [](double v) { return std::isfinite(v) && v >= 0 && v <= kMaxCoordinateMm; };
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const SurfaceRun& run = runs[i];
    if (run.kind < SurfaceClass::Measured || run.kind > SurfaceClass::Doubtful)
      return fail(ErrorCode::InvalidInput, fmt::format("run {} of a contour has no known class", i));
    if (!length(run.gap_mm) || !length(run.error_mm))
      return fail(ErrorCode::InvalidInput, fmt::format("run {} of a contour: gap or error is not a length", i));
    if (run.kind == SurfaceClass::Measured && (run.gap_mm != 0 || run.error_mm != 0))
      return fail(ErrorCode::InvalidInput, fmt::format("run {} of a contour is measured and has a gap or error", i));
    if (run.edges == 0 || (i > 0 && runs[i - 1].kind == run.kind))
      return fail(ErrorCode::InvalidInput, fmt::format("run {} of a contour is empty or goes on the one before", i));
    sum += run.edges;
  }
  if (sum != edges)
    return fail(ErrorCode::InvalidInput, fmt::format("runs of {} edges on a contour of {}", sum, edges));
  if (runs.size() == 1 && runs[0].kind == SurfaceClass::Measured)
    return fail(ErrorCode::InvalidInput, "a contour that is all measured needs no runs");
  return {};
}

}  // namespace telefab
