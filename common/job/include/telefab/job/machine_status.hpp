// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace telefab {

/// What one machine of a fab is at. Numbers go over the wire: never renumber.
enum class MachineState : std::uint8_t {
  Idle = 1,
  Occupied = 2,  ///< a part is on its platform; somebody must take it off and say so
  Printing = 3,
  Paused = 4,   ///< a print hangs in it, dark, and waits for somebody
  Fault = 5,    ///< its last print broke off; it waits for somebody
  Offline = 6,  ///< its devices are not found
};
inline constexpr std::array kMachineStates{MachineState::Idle,   MachineState::Occupied, MachineState::Printing,
                                           MachineState::Paused, MachineState::Fault,    MachineState::Offline};
/// "idle", "occupied", "printing", "paused", "fault", "offline".
[[nodiscard]] std::string_view name_of(MachineState state);

/// One machine as it stands in a fab, and what runs on it now.
struct MachineStatus {
  std::string name;
  std::string profile;  ///< that it is one of
  MachineState state = MachineState::Idle;
  std::string resin;          ///< what its next job is printed with where it names none
  std::string job;            ///< id of the job it holds, or whose part is on its platform; empty: none
  std::string job_name;       ///< file name of that job's scan
  std::uint32_t layer = 0;    ///< layers printed of that job
  std::uint32_t layers = 0;   ///< of its print
  double seconds_left = -1;   ///< of its print; below 0: not known
  std::uint32_t waiting = 0;  ///< jobs that wait and that it could print
  std::string message;        ///< why it is paused, at fault or offline; may be empty
  bool is_stated = false;     ///< named by the fab's own list of machines, not made of a profile alone
  friend bool operator==(const MachineStatus&, const MachineStatus&) = default;
};

/// JSON object on one line, keys in fixed order; a time left that is not known is null.
[[nodiscard]] std::string to_json(const MachineStatus& machine);

/// "12 s", "3 min 20 s", "2 h 05 min".
[[nodiscard]] std::string duration_text(double seconds);

}  // namespace telefab
