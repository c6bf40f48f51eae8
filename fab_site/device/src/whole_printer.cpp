// SPDX-License-Identifier: GPL-3.0-or-later
#include <array>
#include <telefab/fab/device/whole_printer.hpp>

namespace telefab::fab {
namespace {

constexpr std::array<std::string_view, 12> kStates{"none",     "checking", "homing",   "lowering",
                                                   "exposing", "lifting",  "pausing",  "paused",
                                                   "stopping", "stopped",  "complete", "unknown"};

struct ProblemWords {
  std::string_view name, advice;
};
constexpr std::array<ProblemWords, 20> kProblems{{
    {"none", "nothing is wrong"},
    {"busy", "the printer does something else; wait until it is idle, or stop that at its panel"},
    {"file-not-found", "the printer no longer has the file; send it again"},
    {"file-damaged", "the file's checksum does not hold on the printer; send it again"},
    {"file-unreadable", "the printer cannot read the file from its storage; free or renew the storage"},
    {"wrong-resolution", "the file has other pixels than the printer's panel; plan for the profile of this printer"},
    {"wrong-format", "the printer does not take this kind of file"},
    {"wrong-model", "the file names another model; state file.model as the printer calls itself"},
    {"storage-full", "the printer has no room for the file; delete files at its panel"},
    {"temperature", "the printer is too hot, or its temperature sensor is not there"},
    {"resin", "too little or too much resin, or the feeder stands; look at the vat"},
    {"foreign-body", "something lies in the vat, or a part is still on the platform; take it out"},
    {"levelling", "the platform could not be levelled; level it at the printer"},
    {"detached", "the part fell off or warps; stop, and look at the vat"},
    {"force-sensor", "the strain gauge does not answer or is not calibrated"},
    {"display", "the exposure screen is not connected"},
    {"film", "the release film is worn out; change it"},
    {"storage-removed", "the storage that held the file was pulled out"},
    {"motor", "an axis did not home or move as it should"},
    {"other", "the printer names no reason; look at its panel"},
}};

}  // namespace

std::string_view name_of(TaskState state) { return kStates.at(static_cast<std::size_t>(state)); }
std::string_view name_of(PrinterProblem problem) { return kProblems.at(static_cast<std::size_t>(problem)).name; }
std::string_view advice_on(PrinterProblem problem) { return kProblems.at(static_cast<std::size_t>(problem)).advice; }

}  // namespace telefab::fab
