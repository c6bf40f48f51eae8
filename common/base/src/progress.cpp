// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/progress.hpp>

namespace telefab {

std::string_view label_of(WorkStage stage) {
  switch (stage) {
    case WorkStage::FindingAxis:
      return "finding the axis";
    case WorkStage::AligningPairs:
      return "aligning pairs";
    case WorkStage::AdjustingPoses:
      return "adjusting all poses";
    case WorkStage::JudgingPoses:
      return "judging the result";
    case WorkStage::ReadingScan:
      return "reading";
    case WorkStage::PickingObject:
      return "picking the object";
    case WorkStage::FindingNormals:
      return "normals";
    case WorkStage::FittingSurface:
      return "surface";
    case WorkStage::ClosingGaps:
      return "gaps";
    case WorkStage::FindingTopology:
      return "topology";
    case WorkStage::CuttingContours:
      return "contours";
    case WorkStage::ReadingContours:
      return "reading contours";
    case WorkStage::SortingContours:
      return "sorting contours";
    case WorkStage::WritingContours:
      return "writing contours";
    case WorkStage::WritingSlices:
      return "writing slices";
    case WorkStage::PackingSlices:
      return "packing slices";
    case WorkStage::PackingModel:
      return "packing the model";
    case WorkStage::WritingMasks:
      return "writing masks";
    case WorkStage::WritingPictures:
      return "writing pictures";
    case WorkStage::FindingRegions:
      return "layer regions";
    case WorkStage::PlacingAnchors:
      return "anchors";
    case WorkStage::BuildingSupports:
      return "structure";
    case WorkStage::MakingMasks:
      return "making masks";
    case WorkStage::CheckingRegions:
      return "check";
    case WorkStage::CheckingLight:
      return "light";
    case WorkStage::CheckingMasks:
      return "masks";
    case WorkStage::CuringSolid:
      return "curing";
    case WorkStage::EstimatingPrint:
      return "estimating the print";
  }
  return "working";
}

}  // namespace telefab
