// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/service/shared_verbs.hpp>
#include <telefab/service/web_page.hpp>
#include <telefab/web/page_link.hpp>

namespace telefab {
namespace {

struct PageLinkOptions {
  std::string data;
  bool is_json = false;
};

Result<ExitCode> run(const PageLinkOptions& o) {
  const auto address = linked_page_of(o.data);
  if (!address) return tl::unexpected{address.error()};
  const auto key = make_page_key(page_key_in(o.data), SystemClock{}.wall());
  if (!key) return tl::unexpected{key.error()};
  const std::string link = page_link(*address, *key);
  if (o.is_json) {
    const std::int64_t seconds = std::chrono::seconds{kPageLinkLasts}.count();
    write_output(json_text(nlohmann::ordered_json{{"link", link}, {"lasts_s", seconds}}) + "\n");
    return ExitCode::Ok;
  }
  write_note(fmt::format("opens the page signed in, once and within {} minutes:\n", kPageLinkLasts.count()));
  write_output(link + "\n");
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_page_link(VerbOptions& options, const char* data) {
  auto o = std::make_shared<PageLinkOptions>();
  o->data = data;
  options.add("--data", o->data, "the daemon's folder; that of the installed service where none is named")
      .shows_default();
  options.flag("--json", o->is_json, "print link and lasts_s as JSON");
  options.footer(
      "For whoever runs the site, on its machine: only the daemon's user and root can have a link made. It opens what "
      "the token of DATA/web-token opens, and names nobody in the audit log. A newer link takes the place of the one "
      "before. From another machine, forward the port under its own number first: ssh -L 7480:127.0.0.1:7480 SITE. "
      "Where operators have tokens of their own (tokens add NAME), and where the page is shown beyond its machine, "
      "everybody signs in by name and a link is refused.");
  return [o](std::stop_token) { return run(*o); };
}

}  // namespace telefab
