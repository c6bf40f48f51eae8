// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/program.hpp>

// One function a verb; main.cpp holds the table.
namespace telefab::client {
[[nodiscard]] VerbBody declare_submit(VerbOptions& options);
[[nodiscard]] VerbBody declare_jobs(VerbOptions& options);
[[nodiscard]] VerbBody declare_status(VerbOptions& options);
[[nodiscard]] VerbBody declare_watch(VerbOptions& options);
[[nodiscard]] VerbBody declare_machines(VerbOptions& options);
[[nodiscard]] VerbBody declare_resins(VerbOptions& options);
[[nodiscard]] VerbBody declare_prints(VerbOptions& options);
[[nodiscard]] VerbBody declare_approve(VerbOptions& options);
[[nodiscard]] VerbBody declare_pause(VerbOptions& options);
[[nodiscard]] VerbBody declare_resume(VerbOptions& options);
[[nodiscard]] VerbBody declare_cleared(VerbOptions& options);
[[nodiscard]] VerbBody declare_cancel(VerbOptions& options);
[[nodiscard]] VerbBody declare_forget(VerbOptions& options);
[[nodiscard]] VerbBody declare_report(VerbOptions& options);
[[nodiscard]] VerbBody declare_sites(VerbOptions& options);
[[nodiscard]] VerbBody declare_certs(VerbOptions& options);
[[nodiscard]] VerbBody declare_fleet(VerbOptions& options);
}  // namespace telefab::client
