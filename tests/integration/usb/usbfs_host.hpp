// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <telefab/fab/drivers/dlpc900_model.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <thread>

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

/// A GRBL model behind a pseudo terminal.
class PtyHost {
 public:
  PtyHost(fab::LineModel& model, std::mutex& mutex);
  ~PtyHost();
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  int master_ = -1;
  int slave_ = -1;
  std::string path_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace telefab::test
