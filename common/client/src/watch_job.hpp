// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "site_client.hpp"

namespace telefab::client {

enum class WatchStyle : std::uint8_t {
  Screen,  ///< a full screen where there is a terminal, lines elsewhere
  Lines,   ///< on standard error: one for each new state or message, and for each tenth of a state
  Silent
};

/// What --json and --plain ask for.
[[nodiscard]] inline WatchStyle watch_style(bool json, bool plain) {
  return json ? WatchStyle::Silent : plain ? WatchStyle::Lines : WatchStyle::Screen;
}

/// Follows a job until it is final, or until the operator leaves the full screen with q. The job as last seen.
[[nodiscard]] Result<Job> watch_job(SiteClient& client, const std::string& job, WatchStyle style);

}  // namespace telefab::client
