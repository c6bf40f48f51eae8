// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/device/projector.hpp>

namespace telefab::fab {

/// What a light on a stage's board is; read once after construction.
struct StageLightFacts {
  std::string name;                   ///< for the record, e.g. "spindle of GRBL, S up to 800"
  Microseconds shortest_exposure{0};  ///< a shorter one is refused
  Microseconds longest_exposure{0};   ///< a longer one is refused
  Microseconds exposure_step{1};      ///< exposures are whole multiples of it
  Nanoseconds lead{};                 ///< dark, from the order to the light
  std::uint32_t light_steps = 1;      ///< as of a projector
};

struct StageLightStatus {
  bool is_over = false;  ///< dark again, as the board said
  Nanoseconds lit_from{}, lit_until{};
};

/// A light that the board of a stage switches and times by itself: an exposure is handed to it whole, its end included,
/// before the light goes on. Dark after construction. Threads: as its stage's, one caller at a time; bounded calls.
class StageLight {
 public:
  virtual ~StageLight() = default;
  StageLight(const StageLight&) = delete;
  StageLight& operator=(const StageLight&) = delete;

  [[nodiscard]] virtual const StageLightFacts& light_facts() const = 0;
  /// InvalidInput where it could not be made so. Touches no device.
  [[nodiscard]] virtual Result<void> check_light(const LightOrder& order) const = 0;
  /// Orders one exposure; the stage must be homed and at rest. Returns when the board has all of it and is still dark.
  /// DeviceRefused, Conflict and InvalidInput: surely no light was shown; any other error: nobody knows.
  [[nodiscard]] virtual Result<void> light(const LightOrder& order) = 0;
  /// Fails with Device* where the board is lost, restarted, refused or ended at a wrong time; the light must be taken
  /// for on until unlight() succeeds.
  [[nodiscard]] virtual Result<StageLightStatus> poll_light() = 0;
  /// Dark now, by what acts at any point: a restart of the board, by which the stage forgets its place. On failure the
  /// light must be taken for on. Does nothing where the board has said that it is dark.
  [[nodiscard]] virtual Result<void> unlight() = 0;

 protected:
  StageLight() = default;
};

}  // namespace telefab::fab
