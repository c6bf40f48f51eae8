// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/program.hpp>

// One function a verb, each in its own verb_NAME.cpp; main.cpp holds the table.
namespace telefab::scan {
[[nodiscard]] VerbBody declare_api(VerbOptions& options);
[[nodiscard]] VerbBody declare_inspect(VerbOptions& options);
[[nodiscard]] VerbBody declare_clean(VerbOptions& options);
[[nodiscard]] VerbBody declare_digitize(VerbOptions& options);
[[nodiscard]] VerbBody declare_measure(VerbOptions& options);
[[nodiscard]] VerbBody declare_merge(VerbOptions& options);
[[nodiscard]] VerbBody declare_orient(VerbOptions& options);
[[nodiscard]] VerbBody declare_register(VerbOptions& options);
[[nodiscard]] VerbBody declare_slice(VerbOptions& options);
[[nodiscard]] VerbBody declare_serve(VerbOptions& options);
}  // namespace telefab::scan
