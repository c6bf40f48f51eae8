// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <telefab/command_line/options.hpp>
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

/// How a watch goes on where the line breaks or the site starts again.
struct WatchLine {
  std::function<Result<std::unique_ptr<SiteClient>>()> connect;  ///< a new connection
  double patience_min = 10;                                      ///< of trying, before it gives up
  std::stop_token stop;
};
/// --patience-min.
void declare_patience(VerbOptions& options, double& patience_min);

/// Follows a job until it is final, or until the operator leaves the full screen with q. The job as last seen. Where
/// the connection is lost it is made again. Fails with Unreachable once the patience is over, and at once with whatever
/// else goes wrong.
[[nodiscard]] Result<Job> watch_job(std::unique_ptr<SiteClient> client, const WatchLine& line, const std::string& job,
                                    WatchStyle style);

}  // namespace telefab::client
