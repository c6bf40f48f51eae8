// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab {

/// Everything a program says goes through here, results to standard output and remarks to standard error. Nothing of it
/// throws or ends the process, so that an error can always be reported. Threads: from any at once.

/// A result. Where the reader of standard output has gone, this and all that follows is dropped without a word; where
/// it cannot be written otherwise (a full disk) run_program says so in the end and returns ExitCode::Storage.
void write_output(std::string_view text);

/// A remark: progress, a warning, an error. What cannot be written is dropped.
void write_note(std::string_view text);

/// Hands on what write_output kept back. Called by run_program; by others where somebody waits for the text.
/// Fails with StorageFailed once and for all after the first text that could not be written.
Result<void> flush_output();

/// False once the reader of standard output has gone: who would write for ever can stop.
[[nodiscard]] bool is_output_read();

/// Opens /dev/null in place of standard streams that are closed, so that no file of ours gets their numbers, and lets
/// a closed pipe be an error of write() instead of the end of the process. Called by run_program, first of all.
void secure_standard_streams();

}  // namespace telefab
