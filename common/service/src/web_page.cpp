// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>

#include <cerrno>
#include <future>
#include <telefab/base/file.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/program.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/web_page.hpp>
#include <telefab/web/page_link.hpp>

namespace telefab {
namespace {

constexpr auto kCommandTimeout = std::chrono::seconds{5};
constexpr std::uint64_t kLongestAddress = 1024;

std::filesystem::path address_in(const std::filesystem::path& data) { return data / "web-address"; }

bool is_shown_beyond_by(const ServeOptions& options, const net::Endpoint& address) {
  return !net::is_loopback(address) || !options.web_hosts.empty();
}

/// For whoever began the daemon at a terminal, which is nobody else's.
void print_link(const DataFolder& folder, const std::string& address, const Clock& clock) {
  const auto key = make_page_key(page_key_in(folder.path()), clock.wall());
  if (!key) return log_warning(key.error().what);
  write_note(fmt::format("open it signed in, once and within {} minutes (the verb page-link prints another): {}\n",
                         kPageLinkLasts.count(), page_link(address, *key)));
}

}  // namespace

Result<std::string> web_token(const DataFolder& folder) {
  const auto path = folder.path() / "web-token";
  auto read = read_secret(path);
  if (!read && read.error().code != ErrorCode::NotFound) return read;
  if (read) {
    std::string& kept = *read;
    while (!kept.empty() && (kept.back() == '\n' || kept.back() == ' ')) kept.pop_back();
    if (kept.size() < 16)
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("{} holds no token of at least 16 characters; remove it to have one made", path.string()));
    return read;
  }
  auto token = random_token();
  if (!token) return token;
  if (auto written = write_new_secret(path, *token + "\n"); !written) return tl::unexpected{written.error()};
  return token;
}

std::filesystem::path operator_tokens_in(const std::filesystem::path& data) { return data / "operator-tokens"; }

std::filesystem::path page_key_in(const std::filesystem::path& data) { return data / "page-link"; }

Result<std::string> linked_page_of(const std::filesystem::path& data) {
  const OpenFile lock{::open((data / "lock").c_str(), O_RDONLY | O_CLOEXEC)};
  if (lock.get() < 0 && errno == EACCES)
    return fail(ErrorCode::NotPermitted,
                fmt::format("{} is the daemon's own: only its user and root have a link made (sudo)", data.string()));
  if (lock.get() < 0 && errno != ENOENT) return fail_system("read", data / "lock", errno);
  if (lock.get() < 0 || take_lock(lock) != EWOULDBLOCK)
    return fail(ErrorCode::Conflict, fmt::format("no daemon works in {}: start it with the verb serve and --web, or "
                                                 "name its folder with --data",
                                                 data.string()));
  const auto address = read_file(address_in(data), kLongestAddress);
  const auto tokens = read_operator_tokens(operator_tokens_in(data));
  const bool is_by_name = tokens || tokens.error().code != ErrorCode::NotFound;
  if (is_by_name || (!address && address.error().code == ErrorCode::NotFound))
    return fail(ErrorCode::Conflict,
                fmt::format("the daemon in {} shows no page that a link signs in at: it was started without --web, or "
                            "everybody signs in there by name; then `tokens add NAME --data {}` makes a token",
                            data.string(), data.string()));
  if (!address) return tl::unexpected{address.error()};
  std::string text{reinterpret_cast<const char*>(address->data()), address->size()};
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

Result<SignIn> sign_in_of(const ServeOptions& options, const DataFolder& folder, const Clock& clock,
                          SignInEvents events) {
  const auto address = net::endpoint_from_text(options.web);
  if (!address) return fail_in("--web", address.error());
  auto shared = web_token(folder);
  if (!shared) return tl::unexpected{shared.error()};
  const auto tokens = operator_tokens_in(folder.path());
  const bool is_shown_beyond = is_shown_beyond_by(options, *address);
  const auto named = read_operator_tokens(tokens);
  if (!named && named.error().code != ErrorCode::NotFound) return tl::unexpected{named.error()};
  if (!named && is_shown_beyond && options.tls_folder.empty())
    log_warning(
        fmt::format("--web {}: the page is shown beyond this machine, and nobody can sign in: make each operator "
                    "a token with the verb `tokens add NAME --data {}`",
                    options.web, folder.path().string()));
  return SignIn{{tokens, std::move(*shared), is_shown_beyond, page_key_in(folder.path())}, clock, std::move(events)};
}

Result<std::unique_ptr<WebServer>> open_page(const ServeOptions& options, const DataFolder& folder, WebSite& site,
                                             const std::string& product, const Clock& clock) {
  const auto endpoint = net::endpoint_from_text(options.web);
  if (!endpoint) return fail_in("--web", endpoint.error());
  WebAddress address{endpoint->host, endpoint->port, options.web_hosts};
  if (!net::is_loopback(*endpoint)) {
    if (options.tls_folder.empty())
      return fail(
          ErrorCode::NotTrusted,
          fmt::format("--web {}: off loopback the page is served over TLS alone: give --tls FOLDER, reach it by "
                      "ssh -L, or put a TLS proxy before it on this machine and name its host with --web-host",
                      options.web));
    // One of the page's own: its thread reads the files again by itself.
    auto trust = trust_of(options);
    if (!trust) return tl::unexpected{trust.error()};
    address.trust = std::move(*trust);
  }
  auto server = WebServer::listen(address, site, product, clock);
  if (!server) return server;
  const std::string at =
      fmt::format("{}://{}", address.trust ? "https" : "http", net::to_text({endpoint->host, (*server)->port()}));
  log_line(fmt::format("the page is at {}/", at));
  const std::string port = fmt::format("{}\n", (*server)->port());
  if (auto written = write_file_atomically(folder.path() / "web-port", std::string_view{port}); !written)
    return tl::unexpected{written.error()};
  std::error_code ignored;  // of a page that was shown otherwise; where there is none all is well
  std::filesystem::remove(address_in(folder.path()), ignored);
  if (is_shown_beyond_by(options, *endpoint)) return server;
  if (auto written = write_file_atomically(address_in(folder.path()), at + "\n"); !written)
    return tl::unexpected{written.error()};
  if (on_terminal() && !std::filesystem::exists(operator_tokens_in(folder.path()), ignored))
    print_link(folder, at, clock);
  return server;
}

namespace {

/// What `ask` is answered in time; it hands on whom to tell.
template <class Value, class Ask>
Result<Value> answer_in_time(const Ask& ask, const char* late) {
  // Shared, for an answer that comes after this call gave up.
  const auto answered = std::make_shared<std::promise<Result<Value>>>();
  auto answer = answered->get_future();
  ask([answered](Result<Value> value) { answered->set_value(std::move(value)); });
  if (answer.wait_for(kCommandTimeout) != std::future_status::ready) return fail(ErrorCode::Unreachable, late);
  return answer.get();
}

}  // namespace

Result<Job> command_and_wait(const CommandPost& post, const Command& command) {
  return answer_in_time<Job>([&](auto done) { post(command, std::move(done)); },
                             "the daemon is busy; look at the job before you try again");
}

Result<std::filesystem::path> file_and_wait(const FilePost& post, const std::string& job, const std::string& name) {
  return answer_in_time<std::filesystem::path>([&](auto done) { post(job, name, std::move(done)); },
                                               "the fab does not answer in time; try again");
}

Result<void> carry_out(const CommandPost& post, JobCommand command, std::string_view job, std::string_view who,
                       std::string_view although) {
  const auto done = command_and_wait(post, {{}, std::string{job}, command, std::string{who}, std::string{although}});
  if (!done) return tl::unexpected{done.error()};
  return {};
}

}  // namespace telefab
