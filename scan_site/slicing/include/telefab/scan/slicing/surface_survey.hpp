// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <vector>

namespace telefab::scan {

/// What slicing would make of a scan's surface, before a layer is cut: which of it is measured, which would be
/// completed, and where it would be doubtful. Frame and unit of the cloud that was surveyed.
struct SurfaceSurvey {
  struct Sample {
    Vec3 place;
    Eigen::Vector3f normal;  ///< unit, outward
    SurfaceClass kind = SurfaceClass::Measured;
  };
  std::vector<Sample> measured;  ///< that the field keeps; doubtful where the sides, or two sheets, contradict
  std::vector<Sample> added;     ///< completed or doubtful
  std::size_t asked = 0;         ///< samples whose sides were looked at; the others take the nearest one's answer
  double noise = 0;              ///< of the samples across the surface
  double spacing = 0;            ///< of the samples
  double largest_gap = 0;
  Openness open;                      ///< areas in the cloud's unit squared
  std::vector<std::string> warnings;  ///< about gaps, for people, however the scan is turned
};

/// What slicing would say of a surface so open that stands one way.
struct StoodOpenness {
  std::optional<std::string> refusal;  ///< why it would not close it
  std::optional<std::string> warning;  ///< where it would, and it is a guess
};

/// `open`: before the request's mirror and this turn, square millimetres of the print. Whether a missing base is meant
/// depends on the turn, and so do the names of sides.
[[nodiscard]] StoodOpenness judged_openness(const Openness& open, const SliceRequest& request, const Turn& turn);

/// Surveys an oriented cloud with the request's completion and surface. Same bytes on any number of threads. Fails as
/// MlsField::from_cloud and complete_cloud do.
[[nodiscard]] Result<SurfaceSurvey> survey_surface(const PointCloud& prepared, const SliceRequest& request,
                                                   const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::scan
