// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/print/layer_motion.hpp>

namespace telefab::test {

/// A peel and an approach, and a wait wherever there can be one.
inline fab::LayerMotion every_step() {
  return {.approach_mm = 1,
          .approach_speed_mm_per_s = 1,
          .settle_s = 0.4,
          .wait_after_exposure_s = 0.3,
          .peel_mm = 1.5,
          .peel_speed_mm_per_s = 1,
          .wait_after_lift_s = 0.6};
}
/// On a machine whose vat tips as well.
inline fab::LayerMotion every_step_and_tilt() {
  fab::LayerMotion motion = every_step();
  motion.tilt_s = 1.1;
  return motion;
}
/// The vat tips, and the platform never lifts.
inline fab::LayerMotion tilt_alone() {
  fab::LayerMotion motion;
  motion.lift_mm = 0;
  motion.tilt_s = 2;
  motion.wait_after_lift_s = 0.2;
  return motion;
}

}  // namespace telefab::test
