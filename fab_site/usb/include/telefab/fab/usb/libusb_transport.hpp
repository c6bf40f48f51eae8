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

/// Opens the device through libusb, detaches a kernel driver if there is one and claims interface 0. Transfers are
/// asynchronous below and end at their deadline by being cancelled, so no call outlives its timeout by more than the
/// cancellation takes. Fails: DeviceLost (not there; more than one without a serial; no permission, with what to do).
[[nodiscard]] Result<std::unique_ptr<UsbTransport>> open_libusb(const UsbIdentity& identity);

}  // namespace telefab::fab
