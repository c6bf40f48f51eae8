// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <telefab/fab/screen/screen_display.hpp>
#include <vector>

namespace telefab::fab {

/// Which screen, and how it must be.
struct ScreenSettings {
  std::string connector;  ///< "HDMI-A-1"; beginning with '/': a framebuffer or a plain file
  std::string edid;       ///< edid_identity(), or "none"; of a framebuffer not asked for
  PixelSize words;        ///< of the mode
  double refresh_hz = 0;
  PixelPacking packing = PixelPacking::Grey;
};
[[nodiscard]] ScreenSettings screen_settings(const MachineProfile& machine);

/// How to start the guard: a program and its arguments, which end in run_screen_guard().
struct GuardProgram {
  std::string path;
  std::vector<std::string> arguments;
};
/// The program that runs, also where its file was replaced since it was started, with its verb for that.
[[nodiscard]] GuardProgram own_guard_program();

/// Number of the open file by which a guard hears its program.
inline constexpr int kGuardSocket = 3;

/// The guard: a process of its own that alone drives the screen, and shares its open file with the program it watches.
/// A frame that is shown becomes black when its time is over, when the program dies, and when it gives no sign of life
/// for 160 ms, each within 250 ms; that is tried before the screen is used. Returns when its program has ended and the
/// screen is black, with the exit code for main(); 1 where it is called without a program.
[[nodiscard]] int run_screen_guard(int socket);

/// Starts a guard for the screen, which is black when this returns. The clock must outlive the display.
/// Fails: InvalidInput (settings; says what was found), DeviceLost (no such connector or file, nothing connected, not
/// permitted), DeviceRefused (another mode, another EDID, another program has it, a guard that does not darken).
[[nodiscard]] Result<std::unique_ptr<ScreenDisplay>> open_guarded_display(const ScreenSettings& settings,
                                                                          const GuardProgram& program, Clock& clock);

/// Every connector that there is, a line each: its name, what it says of itself, its modes. For people.
[[nodiscard]] std::string describe_screens();

}  // namespace telefab::fab
