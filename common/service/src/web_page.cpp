// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <sys/random.h>

#include <array>
#include <future>
#include <telefab/base/file.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/web_page.hpp>

namespace telefab {
namespace {

constexpr auto kCommandTimeout = std::chrono::seconds{5};
constexpr std::uint64_t kLongestToken = 4096;

}  // namespace

Result<std::string> web_token(const DataFolder& folder) {
  const auto path = folder.path() / "web-token";
  if (const auto bytes = read_file(path, kLongestToken)) {
    std::string kept{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
    while (!kept.empty() && (kept.back() == '\n' || kept.back() == ' ')) kept.pop_back();
    if (kept.size() < 16)
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("{} holds no token of at least 16 characters; remove it to have one made", path.string()));
    return kept;
  }
  std::array<unsigned char, 16> random{};
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size()))
    return fail(ErrorCode::Internal, "no random numbers for the web token");
  std::string token;
  for (const unsigned char byte : random) token += fmt::format("{:02x}", byte);
  if (auto written = write_new_secret(path, token + "\n"); !written) return tl::unexpected{written.error()};
  return token;
}

Result<std::unique_ptr<WebServer>> open_page(const ServeOptions& options, const DataFolder& folder, WebSite& site,
                                             const std::string& product) {
  if (options.web.empty()) return std::unique_ptr<WebServer>{};
  const auto address = net::endpoint_from_text(options.web);
  if (!address) return fail_in("--web", address.error());
  if (!net::is_loopback(*address))
    return fail(
        ErrorCode::NotTrusted,
        fmt::format("--web {}: the page speaks HTTP without TLS, so it is refused off loopback. Reach it by ssh -L, "
                    "or put a TLS proxy before it on this machine and name its host with --web-host",
                    options.web));
  auto server = WebServer::listen(address->host, address->port, site, product, options.web_hosts);
  if (!server) return server;
  log_line(fmt::format("the page is at http://{}:{}/", address->host, (*server)->port()));
  const std::string port = fmt::format("{}\n", (*server)->port());
  if (auto written = write_file_atomically(folder.path() / "web-port", std::string_view{port}); !written)
    return tl::unexpected{written.error()};
  return server;
}

Result<Job> command_and_wait(const CommandPost& post, const Command& command) {
  // Shared, for an answer that comes after this call gave up.
  const auto answered = std::make_shared<std::promise<Result<Job>>>();
  auto answer = answered->get_future();
  post(command, [answered](Result<Job> job) { answered->set_value(std::move(job)); });
  if (answer.wait_for(kCommandTimeout) != std::future_status::ready)
    return fail(ErrorCode::Unreachable, "the daemon is busy; look at the job before you try again");
  return answer.get();
}

Result<void> carry_out(const CommandPost& post, const Command& command) {
  const auto job = command_and_wait(post, command);
  if (!job) return tl::unexpected{job.error()};
  return {};
}

}  // namespace telefab
