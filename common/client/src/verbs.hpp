// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/program.hpp>

// One function a verb; main.cpp holds the table.
namespace telefab::client {
[[nodiscard]] VerbBody declare_submit(CLI::App& options);
[[nodiscard]] VerbBody declare_jobs(CLI::App& options);
[[nodiscard]] VerbBody declare_status(CLI::App& options);
[[nodiscard]] VerbBody declare_watch(CLI::App& options);
[[nodiscard]] VerbBody declare_machines(CLI::App& options);
[[nodiscard]] VerbBody declare_approve(CLI::App& options);
[[nodiscard]] VerbBody declare_pause(CLI::App& options);
[[nodiscard]] VerbBody declare_resume(CLI::App& options);
[[nodiscard]] VerbBody declare_cancel(CLI::App& options);
[[nodiscard]] VerbBody declare_report(CLI::App& options);
[[nodiscard]] VerbBody declare_sites(CLI::App& options);
}  // namespace telefab::client
