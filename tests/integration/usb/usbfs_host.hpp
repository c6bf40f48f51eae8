// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <mutex>
#include <string>
#include <telefab/fab/drivers/dlpc900_model.hpp>

#include "pty_host.hpp"

namespace telefab::test {

/// A DLPC900 model behind an emulated usbfs node, for unmodified libusb in this process and in its children. Needs
/// umockdev's library preloaded. The model runs on the clock given and is touched under `mutex` only.
class UsbfsHost {
 public:
  /// On the bus of another one, whose thread ends with the first of both.
  UsbfsHost(fab::Dlpc900Model& model, std::mutex& mutex, std::string serial, const UsbfsHost* beside = nullptr);
  ~UsbfsHost();
  UsbfsHost(const UsbfsHost&) = delete;
  UsbfsHost& operator=(const UsbfsHost&) = delete;

  /// Pulls the cable: transfers fail, the device leaves sysfs and udev says so.
  void unplug();
  void plug();
  /// It stays on the bus, and nobody can open it any more.
  void spoil_node();
  [[nodiscard]] std::uint64_t ioctls() const;

 private:
  struct Bus;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace telefab::test
