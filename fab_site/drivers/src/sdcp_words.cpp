// SPDX-License-Identifier: GPL-3.0-or-later
#include "sdcp_words.hpp"

#include <algorithm>
#include <array>

namespace telefab::fab::sdcp {
namespace {

using enum PrinterProblem;

constexpr std::array kStates{TaskState::None,    TaskState::Homing,   TaskState::Lowering, TaskState::Exposing,
                             TaskState::Lifting, TaskState::Pausing,  TaskState::Paused,   TaskState::Stopping,
                             TaskState::Stopped, TaskState::Complete, TaskState::Checking};
constexpr std::array kAcks{None,        Busy,      FileNotFound, FileDamaged, FileUnreadable, WrongResolution,
                           WrongFormat, WrongModel};
constexpr std::array kErrors{None, FileDamaged, FileUnreadable, WrongResolution, WrongFormat, WrongModel};
constexpr std::array kReasons{
    None,            // 0
    Temperature,     // 1 over-temperature
    ForceSensor,     // 2 calibration of the strain gauge
    Resin,           // 3 level low
    Resin,           // 4 model needs more than the vat holds
    Resin,           // 5 none detected
    ForeignBody,     // 6
    Levelling,       // 7
    Detached,        // 8
    ForceSensor,     // 9 not connected
    Display,         // 10
    Film,            // 11 uses exceeded
    StorageRemoved,  // 12
    Motor,           // 13 x
    Motor,           // 14 z
    Resin,           // 15 level above its most
    Resin,           // 16 level too low
    Motor,           // 17 home position
    ForeignBody,     // 18 a model on the platform
    Other,           // 19
    Motor,           // 20 motion
    Detached,        // 21 no model seen
    Detached,        // 22 model warps
    Motor,           // 23 y, given up
    FileUnreadable,  // 24
    Other,           // 25 camera
    Other,           // 26 network
    Other,           // 27 server
    Other,           // 28 not bound to an app
    Resin,           // 29 feeder
    Resin,           // 30 container low
    Resin,           // 31 feeder disconnected
    Resin,           // 32 feeder late
    Temperature,     // 33 vat sensor not connected
    Temperature,     // 34 vat too hot
};

template <std::size_t Count>
PrinterProblem of(const std::array<PrinterProblem, Count>& table, std::int64_t number) {
  return number >= 0 && number < static_cast<std::int64_t>(Count) ? table[static_cast<std::size_t>(number)] : Other;
}

}  // namespace

TaskState task_state_of(std::int64_t number) {
  return number >= 0 && number < static_cast<std::int64_t>(kStates.size()) ? kStates[static_cast<std::size_t>(number)]
                                                                           : TaskState::Unknown;
}
std::int64_t number_of(TaskState state) { return std::find(kStates.begin(), kStates.end(), state) - kStates.begin(); }
PrinterProblem problem_of_ack(std::int64_t ack) { return of(kAcks, ack); }
PrinterProblem problem_of_error(std::int64_t number) { return of(kErrors, number); }
PrinterProblem problem_of_reason(std::int64_t reason) { return of(kReasons, reason); }

}  // namespace telefab::fab::sdcp
