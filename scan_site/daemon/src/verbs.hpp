// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/program.hpp>

// One function a verb, each in its own verb_NAME.cpp; main.cpp holds the table.
namespace telefab::scan {
[[nodiscard]] VerbBody declare_inspect(CLI::App& options);
[[nodiscard]] VerbBody declare_clean(CLI::App& options);
[[nodiscard]] VerbBody declare_digitize(CLI::App& options);
[[nodiscard]] VerbBody declare_measure(CLI::App& options);
[[nodiscard]] VerbBody declare_register(CLI::App& options);
[[nodiscard]] VerbBody declare_slice(CLI::App& options);
[[nodiscard]] VerbBody declare_serve(CLI::App& options);
}  // namespace telefab::scan
