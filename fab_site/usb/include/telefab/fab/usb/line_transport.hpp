// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <telefab/fab/usb/usb_transport.hpp>

namespace telefab::fab {

/// A serial line that speaks in lines: a tty, or a model of one. One caller at a time.
/// Fails: DeviceLost (hung up, unplugged), DeviceTimeout (the line takes no bytes), ProtocolBroken (a line without
/// end).
class LineTransport {
 public:
  virtual ~LineTransport() = default;
  LineTransport(const LineTransport&) = delete;
  LineTransport& operator=(const LineTransport&) = delete;

  [[nodiscard]] virtual Result<void> write(std::string_view bytes, Milliseconds timeout) = 0;
  /// The next whole line without its end; nothing when none is complete within `timeout` (0: look and return).
  [[nodiscard]] virtual Result<std::optional<std::string>> read_line(Milliseconds timeout) = 0;
  /// Closes and opens the same device again; what was buffered is dropped.
  [[nodiscard]] virtual Result<void> reopen() = 0;
  [[nodiscard]] virtual std::string describe() const = 0;

 protected:
  LineTransport() = default;
};

}  // namespace telefab::fab
