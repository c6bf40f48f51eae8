// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/fab/mask/mask.hpp>

namespace telefab::fab {

using Microseconds = std::chrono::microseconds;

/// What the light engine is; read once after construction.
struct ProjectorFacts {
  std::string name;                   ///< for logs and the record, e.g. "DLPC900 DLP6500 firmware 6.0.0"
  PixelSize size;                     ///< of every mask
  Microseconds shortest_exposure{0};  ///< a shorter one is refused
  double upload_bytes_per_s = 0;      ///< measured; 0: masks cost no time
  /// Equal steps of its light from dark to full; 1: it cannot be dimmed.
  std::uint32_t light_steps = 1;
  Microseconds exposure_step{0};      ///< exposures are whole multiples of it; 0: any
  Microseconds longest_undivided{0};  ///< it times a longer exposure in parts; 0: none is too long
};

/// How a mask is shown.
struct LightOrder {
  Microseconds duration{0};
  double share = 1;  ///< of full light, (0, 1]
  friend bool operator==(const LightOrder&, const LightOrder&) = default;
};

/// The step of an engine's light that makes a share of it. InvalidInput, with what to do, where none comes within 1 %
/// of it, or the share is not in (0, 1].
[[nodiscard]] Result<std::uint32_t> light_step(double share, std::uint32_t light_steps);

/// How one exposure went, by the projector's clock.
struct ExposureReport {
  Nanoseconds lit_from{};     ///< Clock::now() when the device accepted the start
  Nanoseconds lit_until{};    ///< Clock::now() when the device said it was over; up to one poll late
  std::uint32_t retries = 0;  ///< commands repeated while loading and exposing
  std::uint32_t parts = 1;    ///< exposures the device needed for it; more than one above its longest
};

enum class LightState : std::uint8_t { Empty, Loading, Loaded, Exposing, Exposed };

struct ProjectorStatus {
  LightState state = LightState::Empty;
  ExposureReport report;  ///< meaningful in Exposed
};

/// The light engine. Dark after construction and after destruction; lit only from expose() until the duration given
/// to load() is over, which the device times by itself. Threads: one caller at a time. Every call is bounded in time:
/// long work is started by one call and driven on by poll().
class Projector {
 public:
  virtual ~Projector() = default;
  Projector(const Projector&) = delete;
  Projector& operator=(const Projector&) = delete;

  [[nodiscard]] virtual const ProjectorFacts& facts() const = 0;
  /// Starts to hand mask and exposure to the device; shows nothing. Replaces what was loaded before. Copies the mask.
  /// Fails: InvalidInput (size, exposure, a share of the light it cannot make), Conflict (exposing), Device*.
  [[nodiscard]] virtual Result<void> load(const MaskView& mask, const LightOrder& light) = 0;
  /// Lights the loaded mask and returns when the device has accepted. Conflict unless Loaded.
  [[nodiscard]] virtual Result<void> expose() = 0;
  /// Drives loading on (at most some 20 ms of it), asks an exposure whether it is over. After an error the light
  /// must be taken for on until dark() succeeds.
  [[nodiscard]] virtual Result<ProjectorStatus> poll() = 0;
  /// Goes dark now, from any state, reconnecting if it must; what was loaded is forgotten. On failure the caller must
  /// treat the light as still on.
  [[nodiscard]] virtual Result<void> dark() = 0;
  /// How long load() and its polls would take for this mask. Touches no device.
  [[nodiscard]] virtual Nanoseconds load_time(const MaskView& mask) const = 0;

 protected:
  Projector() = default;
};

}  // namespace telefab::fab
