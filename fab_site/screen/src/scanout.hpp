// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/fab/screen/guarded_display.hpp>

namespace telefab::fab {

/// What is enough to darken a screen by a shared open file, after its guard died: a buffer that is black, and where it
/// belongs. Goes through a socket as bytes.
struct BlackMeans {
  std::uint32_t connector = 0, crtc = 0, buffer = 0;
  std::byte mode[96] = {};  ///< a drmModeModeInfo
};

/// What the guard drives: the hardware, or a file in its place. One thread.
class Scanout {
 public:
  virtual ~Scanout() = default;
  Scanout(const Scanout&) = delete;
  Scanout& operator=(const Scanout&) = delete;

  /// "HDMI-A-1 ..., console cleared": what it found.
  [[nodiscard]] virtual const std::string& name() const = 0;
  [[nodiscard]] virtual Nanoseconds frame() const = 0;
  [[nodiscard]] virtual bool confirms() const = 0;
  /// Copies rows without gaps to where they can be shown from; shows nothing.
  [[nodiscard]] virtual Result<void> prepare(std::span<const std::byte> frame) = 0;
  /// The prepared frame; returns when it is scanned out.
  [[nodiscard]] virtual Result<void> show() = 0;
  /// Black, confirmed as far as the device can.
  [[nodiscard]] virtual Result<void> black() = 0;
  /// Whether it is still there, as far as the device can tell; cheap.
  [[nodiscard]] virtual Result<void> check() { return {}; }
  /// Open file to be shared with the program that the guard watches; -1: there is none.
  [[nodiscard]] virtual int shared_file() const { return -1; }
  [[nodiscard]] virtual BlackMeans black_means() const { return {}; }

 protected:
  Scanout() = default;
};

/// Opens the screen of the settings, black; its console is cleared before, where that is permitted. Fails as
/// open_guarded_display.
[[nodiscard]] Result<std::unique_ptr<Scanout>> open_scanout(const ScreenSettings& settings, Clock& clock);
[[nodiscard]] Result<std::unique_ptr<Scanout>> open_framebuffer(const ScreenSettings& settings);
[[nodiscard]] Result<std::unique_ptr<Scanout>> open_kms(const ScreenSettings& settings, Clock& clock);

/// By a file that a guard shared, once that is dead.
[[nodiscard]] Result<void> blacken_kms(int shared_file, const BlackMeans& means);

}  // namespace telefab::fab
