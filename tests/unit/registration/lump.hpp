// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/digitize/digitize.hpp>
#include <telefab/scan/registration/register_views.hpp>
#include <vector>

namespace telefab::scan {

/// A lump without symmetry, about 60 mm across, as a mesh of latitudes and longitudes.
[[nodiscard]] DigitizeModel lump_mesh();
/// A ball with a dozen bumps of several sizes, about 60 mm across: features enough to find poses by.
[[nodiscard]] DigitizeModel knobbly_mesh();
/// The same with a mirror plane across y, which `asymmetry_mm` bends a little.
[[nodiscard]] DigitizeModel near_symmetric_mesh(double asymmetry_mm);

/// Range images of one turn and their true poses.
struct Scene {
  std::vector<RangeImage> images;
  std::vector<RigidMotion> truth;     ///< view to the frame of view 0
  std::vector<RigidMotion> to_model;  ///< view to that of the model
};
[[nodiscard]] Scene scene_of(const DigitizeModel& model, const DigitizeOptions& options);
[[nodiscard]] DigitizeModel moved(DigitizeModel model, const RigidMotion& motion);

}  // namespace telefab::scan
