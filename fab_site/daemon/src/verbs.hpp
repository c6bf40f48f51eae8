// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/program.hpp>

// One function a verb, each in its own verb_NAME.cpp; main.cpp holds the table.
namespace telefab::fab {
[[nodiscard]] VerbBody declare_calibrate(CLI::App& options);
[[nodiscard]] VerbBody declare_export(CLI::App& options);
[[nodiscard]] VerbBody declare_import(CLI::App& options);
[[nodiscard]] VerbBody declare_cover(CLI::App& options);
[[nodiscard]] VerbBody declare_plan(CLI::App& options);
[[nodiscard]] VerbBody declare_predict(CLI::App& options);
[[nodiscard]] VerbBody declare_probe(CLI::App& options);
[[nodiscard]] VerbBody declare_serve(CLI::App& options);
[[nodiscard]] VerbBody declare_simulate_usb(CLI::App& options);
[[nodiscard]] VerbBody declare_supports(CLI::App& options);
[[nodiscard]] VerbBody declare_verify(CLI::App& options);
}  // namespace telefab::fab
