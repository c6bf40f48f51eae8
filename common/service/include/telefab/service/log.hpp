// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab {

/// What a line is about: JOB= and LAYER= in the journal, so that `journalctl JOB=...` finds it.
struct LogFields {
  std::string_view job;  ///< empty: none
  std::int64_t layer = -1;
};

/// One event a line. Under systemd it goes to the journal with its fields, else to standard error with time and level.
/// Lines never hold tokens, keys or file contents. Threads: any.
void log_line(std::string_view text, const LogFields& fields = {});
void log_warning(std::string_view text, const LogFields& fields = {});
/// Shown with --log-level debug only.
void log_detail(std::string_view text, const LogFields& fields = {});

/// "debug", "info" or "warning": what is written from now on. InvalidInput lists them.
[[nodiscard]] Result<void> set_log_level(std::string_view name);

}  // namespace telefab
