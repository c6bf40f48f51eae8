// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/serve_options.hpp>
#include <telefab/web/sign_in.hpp>
#include <telefab/web/web_server.hpp>
#include <telefab/wire/message.hpp>

namespace telefab {

/// The token of DATA/web-token; made, readable by the daemon's user alone, where there is none. NotTrusted: others can
/// read it.
[[nodiscard]] Result<std::string> web_token(const DataFolder& folder);

/// The operators' own tokens, as the verb `tokens` keeps them.
[[nodiscard]] std::filesystem::path operator_tokens_in(const std::filesystem::path& data);

/// The newest link that signs somebody in (page_link.hpp).
[[nodiscard]] std::filesystem::path page_key_in(const std::filesystem::path& data);

/// Where the page of the daemon that works in this folder is, as http://127.0.0.1:7480, for a link that signs in there.
/// Conflict: no daemon works there, or its page takes no link, since everybody signs in by a name; else as read_file.
[[nodiscard]] Result<std::string> linked_page_of(const std::filesystem::path& data);

/// Who comes in at the page of --web. Everybody signs in where DATA has tokens of operators, and where the page is
/// shown beyond this machine: off loopback, or by a proxy (--web-host). Fails as web_token, endpoint_from_text and
/// read_operator_tokens.
[[nodiscard]] Result<SignIn> sign_in_of(const ServeOptions& options, const DataFolder& folder, const Clock& clock,
                                        SignInEvents events);

/// Opens a site's page on --web and says its port in DATA/web-port, and in DATA/web-address where links sign in, and
/// prints one on a terminal: HTTP on loopback, elsewhere over TLS with the
/// certificate of --tls. Fails as WebServer::listen and trust_of, and with NotTrusted off loopback without --tls.
[[nodiscard]] Result<std::unique_ptr<WebServer>> open_page(const ServeOptions& options, const DataFolder& folder,
                                                           WebSite& site, const std::string& product,
                                                           const Clock& clock);

/// Hands a command to the daemon's loop; the answer comes on the loop's thread.
using CommandPost = std::function<void(const Command&, std::function<void(Result<Job>)>)>;

/// Has the daemon's loop fetch a file of a job's reports; the answer, where it lies, comes on the loop's thread.
using FilePost = std::function<void(const std::string& job, const std::string& name,
                                    std::function<void(Result<std::filesystem::path>)>)>;

/// From the page's thread, and waits for the answer: Unreachable after five seconds.
[[nodiscard]] Result<std::filesystem::path> file_and_wait(const FilePost& post, const std::string& job,
                                                          const std::string& name);

/// Gives a command from the page's thread and waits for its answer: Unreachable after five seconds, though the command
/// may still be carried out.
[[nodiscard]] Result<Job> command_and_wait(const CommandPost& post, const Command& command);
/// The same where what becomes of the job is of no interest. `job`, `although`: as in Command.
[[nodiscard]] Result<void> carry_out(const CommandPost& post, JobCommand command, std::string_view job,
                                     std::string_view who, std::string_view although = {});

}  // namespace telefab
