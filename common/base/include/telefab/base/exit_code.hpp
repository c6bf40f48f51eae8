// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/result.hpp>

namespace telefab {

/// Exit codes of all three programs; `--help` and the README list them. Never renumber.
enum class ExitCode {
  Ok = 0,
  Usage = 1,            ///< the command line is wrong
  Refused = 2,          ///< the input was read and is not acceptable
  SiteUnreachable = 3,  ///< no connection, or it was lost for good
  NotTrusted = 4,       ///< certificate, signature or digest does not hold
  JobFailed = 5,        ///< the job ended in `failed`
  Cancelled = 6,        ///< the job or the command was cancelled
  Storage = 7,          ///< a file could not be read or written
  NotCertified = 8,     ///< --require-certified and a layer is flagged; verify found a fault
  Device = 9,           ///< projector or stage lost, silent or refusing
  NotSigned = 10,       ///< verify: the as-built record is as planned, but signed by nobody
  Internal = 70,        ///< a fault of ours; please report it
};

[[nodiscard]] ExitCode exit_code_for(ErrorCode code);

/// The table for `--help`: one line a code.
[[nodiscard]] std::string_view exit_code_table();

}  // namespace telefab
