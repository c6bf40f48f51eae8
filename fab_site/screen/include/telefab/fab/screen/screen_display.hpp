// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// What a display is; read once after construction.
struct DisplayFacts {
  std::string name;  ///< for the record, e.g. "HDMI-A-1 540 x 2560 at 59.94 Hz (RHT 1234 0 QEMU Monitor)"
  PixelSize words;   ///< of its frames
  std::uint32_t word_bytes = 4;
  Nanoseconds frame{};    ///< one refresh
  bool confirms = false;  ///< says when a frame is the one that is scanned out
};

/// A screen with two frames: one that is shown, black after construction, and one that is prepared. Threads: one caller
/// at a time. Every call is bounded in time.
class ScreenDisplay {
 public:
  virtual ~ScreenDisplay() = default;
  ScreenDisplay(const ScreenDisplay&) = delete;
  ScreenDisplay& operator=(const ScreenDisplay&) = delete;

  [[nodiscard]] virtual const DisplayFacts& facts() const = 0;
  /// The hidden frame, to be written to: words.height_px rows without gaps. Valid until the display ends.
  [[nodiscard]] virtual std::span<std::byte> hidden() = 0;
  /// Hands the hidden frame to the screen; shows nothing. Fails with Device*.
  [[nodiscard]] virtual Result<void> prepare() = 0;
  /// Shows the prepared frame and returns once the screen says that it is scanned out. It is black again by itself
  /// after that time, and sooner where this program dies or hangs. On failure black() must follow.
  [[nodiscard]] virtual Result<void> show(Nanoseconds at_most) = 0;
  /// Whether the frame is still shown; fails with Device* where it went black before its time, or may have.
  [[nodiscard]] virtual Result<bool> is_shown() = 0;
  /// Black now, from any state, and confirmed. Fails with Device*: the frame must be taken for shown.
  [[nodiscard]] virtual Result<void> black() = 0;

 protected:
  ScreenDisplay() = default;
};

}  // namespace telefab::fab
