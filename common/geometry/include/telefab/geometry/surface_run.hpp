// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// What a stretch of a contour rests on. Numbers go over the wire: never renumber. The larger, the less is known.
enum class SurfaceClass : std::uint8_t {
  Measured = 1,   ///< samples of the scan lie beside it
  Completed = 2,  ///< continued across a place the scan does not show
  Doubtful = 3,   ///< two ways to tell where the surface is differ here
};
/// "measured", "completed", "doubtful".
[[nodiscard]] std::string_view name_of(SurfaceClass kind);

/// Edges of a contour in a row that rest on the same. Edge i leads from vertex i to the next.
struct SurfaceRun {
  SurfaceClass kind = SurfaceClass::Measured;
  std::uint32_t edges = 1;  ///< >= 1
  double gap_mm = 0;        ///< largest distance to the nearest measured sample; 0 where measured
  double error_mm = 0;      ///< the contour may be wrong by so much (19 cases of 20); 0 where measured or unknown
  friend bool operator==(const SurfaceRun&, const SurfaceRun&) = default;
};

/// Neighbours of one class made one, with the larger gap and error; nothing where all is measured: the one form in
/// which runs are kept.
[[nodiscard]] std::vector<SurfaceRun> merged(std::span<const SurfaceRun> runs);

/// One run an edge: the runs, taken apart again. `edges`: of the contour, all measured where there are no runs.
[[nodiscard]] std::vector<SurfaceRun> one_an_edge(std::span<const SurfaceRun> runs, std::size_t edges);

/// Whether the runs are in merged form, account for so many edges, and their lengths are finite, not negative, and 0
/// where measured. InvalidInput otherwise.
[[nodiscard]] Result<void> validate_runs(std::span<const SurfaceRun> runs, std::size_t edges);

}  // namespace telefab
