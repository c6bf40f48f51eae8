// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/base/exit_code.hpp>
#include <telefab/job/job.hpp>

namespace telefab::client {

/// The machine it is for; where it is on one of several, that one first: "hall-1 (machine-a)".
[[nodiscard]] std::string machine_text(const Job& job);
/// One line for lists.
[[nodiscard]] std::string to_line(const Job& job);
/// What matters when a job has ended: layers, bytes, seconds a stage; several lines.
[[nodiscard]] std::string summary_of(const Job& job);
/// How far the present state is, 0 to 1.
[[nodiscard]] double progress_of(const Job& job);
/// "slicing 40 of 500 layers"
[[nodiscard]] std::string progress_text(const Job& job);
/// Ok, JobFailed or Cancelled for a final job.
[[nodiscard]] ExitCode exit_code_of(const Job& job);

}  // namespace telefab::client
