// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// What a machine needs of the computer for itself alone.
enum class ClaimKind : std::uint8_t {
  LightEngine,   ///< on USB
  StageBoard,    ///< behind a tty
  Screen,        ///< a connector, a framebuffer
  WholePrinter,  ///< in the network
};
/// "light engine", ...
[[nodiscard]] std::string_view name_of(ClaimKind kind);

/// One device that a profile names. Every kind of device that make_devices() opens has its row in devices_of().
struct DeviceClaim {
  ClaimKind kind = ClaimKind::LightEngine;
  std::string identity;  ///< serial number, path of a tty, connector, board or address; empty: the only one found
  std::string_view key;  ///< of the profile, that states it
  friend bool operator==(const DeviceClaim&, const DeviceClaim&) = default;
};

/// The devices that a machine opens; none where all are virtual.
[[nodiscard]] std::vector<DeviceClaim> devices_of(const MachineProfile& machine);
/// Whether both may turn out to be one device: of one kind, and of one identity or one of them of none.
[[nodiscard]] bool may_be_one(const DeviceClaim& a, const DeviceClaim& b);

}  // namespace telefab::fab
