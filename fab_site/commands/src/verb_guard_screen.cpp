// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/screen/guarded_display.hpp>

#include "verbs.hpp"

namespace telefab::fab {

VerbBody declare_guard_screen(VerbOptions&) {
  return [](const std::stop_token&) -> Result<ExitCode> {
    if (run_screen_guard(kGuardSocket) == 0) return ExitCode::Ok;
    return fail(
        ErrorCode::DeviceLost,
        "no screen to guard, or it does not become black; this verb is started by the program that uses a screen "
        "(devices.projector = \"screen\")");
  };
}

}  // namespace telefab::fab
