// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab {

using Milliseconds = std::chrono::milliseconds;

/// One claimed USB interface, as bytes on its endpoints. Blocking, one caller at a time, every call bounded by
/// `timeout`. Fails: DeviceRefused (the endpoint is halted: clear_halt() before the next transfer), DeviceTimeout (the
/// device did not take or give anything in time), DeviceLost (gone, or a broken transfer).
class UsbTransport {
 public:
  virtual ~UsbTransport() = default;
  UsbTransport(const UsbTransport&) = delete;
  UsbTransport& operator=(const UsbTransport&) = delete;

  /// One OUT transfer of the whole span.
  [[nodiscard]] virtual Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes,
                                           Milliseconds timeout) = 0;
  /// One IN transfer of at most max_bytes; shorter when the device sends less.
  [[nodiscard]] virtual Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t max_bytes,
                                                            Milliseconds timeout) = 0;
  [[nodiscard]] virtual Result<void> clear_halt(std::uint8_t endpoint) = 0;
  /// Closes, looks for the same device again and claims it. DeviceLost when it is not there.
  [[nodiscard]] virtual Result<void> reopen() = 0;
  /// Identity and descriptors for people, one fact a line.
  [[nodiscard]] virtual std::string describe() const = 0;

 protected:
  UsbTransport() = default;
};

}  // namespace telefab::fab
