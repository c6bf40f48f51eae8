// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <functional>
#include <string_view>

namespace telefab {

/// What long work is at. Programs tell stages apart by these, people by their labels; both stand in progress.cpp alone.
enum class WorkStage : std::uint8_t {
  FindingAxis = 1,
  AligningPairs,
  AdjustingPoses,
  JudgingPoses,
  ReadingScan,
  PickingObject,
  FindingNormals,
  FittingSurface,
  ClosingGaps,
  FindingTopology,
  CuttingContours,
  ReadingContours,
  SortingContours,
  WritingContours,
  WritingSlices,
  PackingSlices,
  PackingModel,
  WritingPictures,
  WritingMasks,
  FindingRegions,
  PlacingAnchors,
  BuildingSupports,
  MakingMasks,
  CheckingRegions,
  CheckingLight,
  CheckingMasks,
  CuringSolid,
  EstimatingPrint,
};
/// "making masks", ...
[[nodiscard]] std::string_view label_of(WorkStage stage);

/// How far a piece of long work is.
struct Progress {
  WorkStage stage{};
  double fraction = 0;  ///< 0 to 1 of this stage
};

/// Called from the thread that does the work, at most once a layer or block. May be empty.
using ProgressSink = std::function<void(const Progress&)>;

inline void report(const ProgressSink& sink, WorkStage stage, double fraction) {
  if (sink) sink(Progress{stage, fraction});
}

}  // namespace telefab
