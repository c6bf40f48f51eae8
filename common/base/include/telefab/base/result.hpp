// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace telefab {

/// What the caller can do about a failure. Numbers cross the wire: never renumber, never reuse.
enum class ErrorCode {
  InvalidInput = 1,    ///< the data or the argument is wrong; give other data
  NotConverged = 2,    ///< an iteration did not settle; give better data or other options
  Cancelled = 3,       ///< somebody asked to stop
  DeviceLost = 4,      ///< the device is gone; look at cable and power
  DeviceTimeout = 5,   ///< the device did not answer in time
  DeviceRefused = 6,   ///< the device answered and said no
  ProtocolBroken = 7,  ///< the other side sent bytes it must not send
  NotFound = 8,        ///< no such file, job, machine or layer
  NotPermitted = 9,    ///< the file system or the policy forbids it
  StorageFailed = 10,  ///< disk full, read or write error
  Unreachable = 11,    ///< no connection to the other site
  NotTrusted = 12,     ///< certificate, signature or digest does not hold
  TooLarge = 13,       ///< above a stated limit
  Conflict = 14,       ///< not possible in the present state
  Internal = 15,       ///< a fault of ours
};

/// A short name for logs and JSON, e.g. "invalid-input".
[[nodiscard]] std::string_view name_of(ErrorCode code);

/// What failed, where, and what to do. The text is for people and is never parsed.
struct [[nodiscard]] Error {
  ErrorCode code = ErrorCode::Internal;
  std::string what;
  friend bool operator==(const Error&, const Error&) = default;
};

/// The one place that names the library; std::expected takes over with C++23.
template <class T>
using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> fail(ErrorCode code, std::string what) {
  return tl::unexpected<Error>{Error{code, std::move(what)}};
}

/// Somebody asked to stop: `return cancelled("reading points")`.
[[nodiscard]] tl::unexpected<Error> cancelled(std::string_view while_doing);

/// Hands an error on, with a word about where: `return fail_in("reading x.ply", result.error())`.
[[nodiscard]] tl::unexpected<Error> fail_in(std::string_view where, const Error& cause);

}  // namespace telefab
