// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <telefab/fab/usb/line_transport.hpp>

namespace telefab::fab {

/// Opens a serial port at 115200 baud, eight bits, no parity, raw and exclusive. Opening restarts Arduino-like boards.
/// `which`: a path (begins with '/'), the USB serial number of the adapter, or empty for the only USB serial port
/// there is; a port's number is never used, since it changes with every replug.
/// Fails: DeviceLost (none, more than one, no permission; says what was found and what to do).
[[nodiscard]] Result<std::unique_ptr<LineTransport>> open_tty(const std::string& which);

}  // namespace telefab::fab
