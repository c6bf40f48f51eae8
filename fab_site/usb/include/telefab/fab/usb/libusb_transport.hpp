// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <telefab/fab/usb/usb_transport.hpp>

namespace telefab::fab {

/// Which USB device: product ids, and its serial number where there may be several (empty: the only one).
struct UsbIdentity {
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::string serial;
};

/// How a device that was unplugged is found again.
enum class UsbArrival : std::uint8_t {
  Callback,  ///< libusb's hotplug callback where the library has it, else polling
  Poll,      ///< the list of devices, every 20 ms
};

/// Opens the device through libusb, detaches a kernel driver if there is one and claims interface 0. Transfers are
/// asynchronous below and end at their deadline by being cancelled, so no call outlives its timeout by more than the
/// cancellation takes. Fails: DeviceLost (not there; several that fit, with their serials; one that may be the one
/// cannot be opened, with what to do). reopen() waits up to 0.2 s for a device that is not there; a device known to
/// have left fails at once everywhere else.
[[nodiscard]] Result<std::unique_ptr<UsbTransport>> open_libusb(const UsbIdentity& identity,
                                                                UsbArrival arrival = UsbArrival::Callback);

}  // namespace telefab::fab
