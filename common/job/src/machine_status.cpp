// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/job/machine_status.hpp>

namespace telefab {

std::string_view name_of(MachineState state) {
  switch (state) {
    case MachineState::Idle:
      return "idle";
    case MachineState::Occupied:
      return "occupied";
    case MachineState::Printing:
      return "printing";
    case MachineState::Paused:
      return "paused";
    case MachineState::Fault:
      return "fault";
    case MachineState::Offline:
      return "offline";
  }
  return "offline";
}

std::string to_json(const MachineStatus& machine) {
  nlohmann::ordered_json object{
      {"name", machine.name},       {"profile", machine.profile}, {"state", name_of(machine.state)},
      {"resin", machine.resin},     {"job", machine.job},         {"job_name", machine.job_name},
      {"layer", machine.layer},     {"layers", machine.layers},   {"seconds_left", nullptr},
      {"waiting", machine.waiting}, {"message", machine.message}, {"stated", machine.is_stated}};
  if (machine.seconds_left >= 0) object["seconds_left"] = machine.seconds_left;
  return json_text(object);
}

std::string duration_text(double seconds) {
  const auto s = static_cast<long>(std::lround(seconds));
  if (s >= 3600) return fmt::format("{} h {:02} min", s / 3600, s / 60 % 60);
  if (s >= 60) return fmt::format("{} min {:02} s", s / 60, s % 60);
  return fmt::format("{} s", s);
}

}  // namespace telefab
