// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/exit_code.hpp>
#include <telefab/base/result.hpp>

namespace telefab {

tl::unexpected<Error> cancelled(std::string_view while_doing) {
  return fail(ErrorCode::Cancelled, fmt::format("cancelled while {}", while_doing));
}

tl::unexpected<Error> fail_in(std::string_view where, const Error& cause) {
  return fail(cause.code, fmt::format("{}: {}", where, cause.what));
}

std::string_view name_of(ErrorCode code) {
  switch (code) {
    case ErrorCode::InvalidInput:
      return "invalid-input";
    case ErrorCode::NotConverged:
      return "not-converged";
    case ErrorCode::Cancelled:
      return "cancelled";
    case ErrorCode::DeviceLost:
      return "device-lost";
    case ErrorCode::DeviceTimeout:
      return "device-timeout";
    case ErrorCode::DeviceRefused:
      return "device-refused";
    case ErrorCode::ProtocolBroken:
      return "protocol-broken";
    case ErrorCode::NotFound:
      return "not-found";
    case ErrorCode::NotPermitted:
      return "not-permitted";
    case ErrorCode::StorageFailed:
      return "storage-failed";
    case ErrorCode::Unreachable:
      return "unreachable";
    case ErrorCode::NotTrusted:
      return "not-trusted";
    case ErrorCode::TooLarge:
      return "too-large";
    case ErrorCode::Conflict:
      return "conflict";
    case ErrorCode::Internal:
      return "internal";
  }
  return "internal";
}

ExitCode exit_code_for(ErrorCode code) {
  switch (code) {
    case ErrorCode::InvalidInput:
    case ErrorCode::NotConverged:
    case ErrorCode::TooLarge:
    case ErrorCode::Conflict:
      return ExitCode::Refused;
    case ErrorCode::Cancelled:
      return ExitCode::Cancelled;
    case ErrorCode::DeviceLost:
    case ErrorCode::DeviceTimeout:
    case ErrorCode::DeviceRefused:
      return ExitCode::Device;
    case ErrorCode::ProtocolBroken:
    case ErrorCode::Unreachable:
      return ExitCode::SiteUnreachable;
    case ErrorCode::NotFound:
    case ErrorCode::NotPermitted:
    case ErrorCode::StorageFailed:
      return ExitCode::Storage;
    case ErrorCode::NotTrusted:
      return ExitCode::NotTrusted;
    case ErrorCode::Internal:
      return ExitCode::Internal;
  }
  return ExitCode::Internal;
}

std::string_view exit_code_table() {
  return "Exit codes:\n"
         "   0  done\n"
         "   1  the command line is wrong: an unknown word, an option missing or out of its range\n"
         "   2  what it names is not acceptable: no such machine or job, a scan that shows nothing, a place taken\n"
         "   3  the other site cannot be reached, or broke the protocol\n"
         "   4  a certificate, signature or digest does not hold, or does not permit what was asked\n"
         "   5  the job failed\n"
         "   6  cancelled\n"
         "   7  a file could not be read or written\n"
         "   8  a layer is flagged (--require-certified), or verify found a fault\n"
         "   9  projector or stage lost, silent or refusing\n"
         "  10  verify: the as-built record is as planned, but nobody signed it\n"
         "  70  a fault of Telefab; please report it\n";
}

}  // namespace telefab
