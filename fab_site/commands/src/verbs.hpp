// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/program.hpp>

// One function a verb, each in its own verb_NAME.cpp; main.cpp holds the table.
namespace telefab::fab {
[[nodiscard]] VerbBody declare_api(VerbOptions& options);
[[nodiscard]] VerbBody declare_calibrate(VerbOptions& options);
[[nodiscard]] VerbBody declare_export(VerbOptions& options);
[[nodiscard]] VerbBody declare_guard_screen(VerbOptions& options);
[[nodiscard]] VerbBody declare_import(VerbOptions& options);
[[nodiscard]] VerbBody declare_cover(VerbOptions& options);
[[nodiscard]] VerbBody declare_plan(VerbOptions& options);
[[nodiscard]] VerbBody declare_predict(VerbOptions& options);
[[nodiscard]] VerbBody declare_printers(VerbOptions& options);
[[nodiscard]] VerbBody declare_probe(VerbOptions& options);
[[nodiscard]] VerbBody declare_send(VerbOptions& options);
[[nodiscard]] VerbBody declare_serve(VerbOptions& options);
[[nodiscard]] VerbBody declare_simulate_printer(VerbOptions& options);
[[nodiscard]] VerbBody declare_simulate_usb(VerbOptions& options);
[[nodiscard]] VerbBody declare_supports(VerbOptions& options);
[[nodiscard]] VerbBody declare_verify(VerbOptions& options);
}  // namespace telefab::fab
