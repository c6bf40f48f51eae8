// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab::scan {

/// What somebody asked for a job that is a matter of who prints it and when, not of its layers.
struct JobWishes {
  std::string machine;                ///< one by name, or a profile
  int priority = 0;                   ///< larger ones first
  std::int64_t deadline_unix_ms = 0;  ///< 0: none
  std::uint32_t copies = 1;
};

/// What a submitted job asks: its machine and the rows of slice_parameter_table() that are of fleets. InvalidInput
/// names the parameter.
[[nodiscard]] Result<JobWishes> job_wishes_from(std::string_view machine, std::string_view parameters);

/// 2027-03-01T08:00Z, universal time, as milliseconds since 1970. InvalidInput: it is none.
[[nodiscard]] Result<std::int64_t> unix_ms_from(std::string_view time);

}  // namespace telefab::scan
