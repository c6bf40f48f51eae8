// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/serve_options.hpp>
#include <telefab/web/web_server.hpp>
#include <telefab/wire/message.hpp>

namespace telefab {

/// The token of DATA/web-token; made, readable by the daemon's user alone, where there is none.
[[nodiscard]] Result<std::string> web_token(const DataFolder& folder);

/// Opens a site's page on --web and tells its port in DATA/web-port. Null where --web is empty. Fails as
/// WebServer::listen.
[[nodiscard]] Result<std::unique_ptr<WebServer>> open_page(const ServeOptions& options, const DataFolder& folder,
                                                           WebSite& site, const std::string& product);

/// Hands a command to the daemon's loop; the answer comes on the loop's thread.
using CommandPost = std::function<void(const Command&, std::function<void(Result<Job>)>)>;

/// Gives a command from the page's thread and waits for its answer: Unreachable after five seconds, though the command
/// may still be carried out.
[[nodiscard]] Result<Job> command_and_wait(const CommandPost& post, const Command& command);
/// The same where what becomes of the job is of no interest.
[[nodiscard]] Result<void> carry_out(const CommandPost& post, const Command& command);

}  // namespace telefab
