// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/net/endpoint.hpp>

#include "common_options.hpp"
#include "site_book.hpp"
#include "verbs.hpp"

namespace telefab::client {
namespace {

struct SitesOptions {
  std::string action = "list";
  SiteEntry site;
  double timeout_s = 5;
  bool json = false;
  bool names = false;
};

Result<ExitCode> list(const SiteBook& book, const std::filesystem::path& path, bool json, bool names) {
  if (names) {
    for (const SiteEntry& site : book.sites) write_output(fmt::format("{}\n", site.name));
    return ExitCode::Ok;
  }
  if (json) {
    nlohmann::ordered_json sites = nlohmann::ordered_json::array();
    for (const SiteEntry& site : book.sites)
      sites.push_back({{"name", site.name},
                       {"address", site.address},
                       {"tls", site.tls_folder},
                       {"tls_name", site.tls_name},
                       {"certificate", site.certificate},
                       {"default", site.name == book.default_site}});
    write_output(fmt::format("{}\n", json_text({{"file", path.string()}, {"sites", sites}})));
    return ExitCode::Ok;
  }
  if (book.sites.empty())
    write_output(fmt::format(
        "no sites yet in {}; add one: telefab sites add chicago --address HOST:PORT --tls FOLDER\n", path.string()));
  for (const SiteEntry& site : book.sites)
    write_output(fmt::format("{} {:<16} {:<28} {}\n", site.name == book.default_site ? '*' : ' ', site.name,
                             site.address,
                             site.tls_folder.empty() ? std::string{"plain TCP on this machine"}
                                                     : fmt::format("{} of {}", site.tls_name, site.tls_folder)));
  return ExitCode::Ok;
}

/// Calls every site, or the named one; the exit code is that of the first failure.
Result<ExitCode> check(const SiteBook& book, const SitesOptions& o, std::stop_token stop) {
  ExitCode outcome = ExitCode::Ok;
  for (const SiteEntry& site : book.sites) {
    if (!o.site.name.empty() && site.name != o.site.name) continue;
    CommonOptions common;
    common.site = site.address;
    common.tls_folder = site.tls_folder;
    common.tls_name = site.tls_name;
    common.site_certificate = site.certificate;
    common.timeout_s = o.timeout_s;
    const auto client = connect(common, stop);
    if (client) {
      write_output(fmt::format("  {:<16} answers at {}\n", site.name, site.address));
      continue;
    }
    write_output(fmt::format("  {:<16} {}\n", site.name, client.error().what));
    if (outcome == ExitCode::Ok) outcome = exit_code_for(client.error().code);
  }
  return outcome;
}

Result<void> change(SiteBook& book, const SitesOptions& o) {
  const auto named = std::ranges::find(book.sites, o.site.name, &SiteEntry::name);
  if (o.action == "add") {
    if (auto valid = validate(o.site); !valid) return valid;
    if (named != book.sites.end())
      *named = o.site;
    else
      book.sites.push_back(o.site);
    std::ranges::sort(book.sites, {}, &SiteEntry::name);
    if (book.sites.size() == 1) book.default_site = o.site.name;
    return {};
  }
  if (named == book.sites.end())
    return fail(ErrorCode::InvalidInput, fmt::format("no site {} is known; `telefab sites` lists them", o.site.name));
  if (o.action == "default") {
    book.default_site = o.site.name;
    return {};
  }
  if (book.default_site == o.site.name) book.default_site.clear();
  book.sites.erase(named);
  return {};
}

Result<ExitCode> run(const SitesOptions& o, std::stop_token stop) {
  const std::filesystem::path path = site_book_path();
  auto book = read_site_book(path);
  if (!book) return tl::unexpected{book.error()};
  if (o.action == "list") return list(*book, path, o.json, o.names);
  if (!o.site.name.empty() || o.action != "check") {
    if (o.site.name.empty())
      return fail(ErrorCode::InvalidInput, fmt::format("telefab sites {} needs the NAME of a site", o.action));
    if (o.action == "check" && !book->find(o.site.name))
      return fail(ErrorCode::InvalidInput, fmt::format("no site {} is known; `telefab sites` lists them", o.site.name));
  }
  if (o.action == "check") return check(*book, o, std::move(stop));
  if (auto changed = change(*book, o); !changed) return tl::unexpected{changed.error()};
  if (auto written = write_site_book(path, *book); !written) return tl::unexpected{written.error()};
  return list(*book, path, o.json, false);
}

}  // namespace

VerbBody declare_sites(VerbOptions& options) {
  auto o = std::make_shared<SitesOptions>();
  options.add("ACTION", o->action, "list, add (or change), remove, default (what --site is unless told), check")
      .one_of({"list", "add", "remove", "default", "check"})
      .shows_default();
  options.add("NAME", o->site.name, "your name for the site: a-z, 0-9 and -");
  options.add("--address", o->site.address, "add: HOST:PORT").read_by(net::endpoint_from_text);
  options.add("--tls", o->site.tls_folder,
              "add: folder with authority.crt, NAME.crt, NAME.key and revoked.crl; needed off loopback");
  options.add("--tls-name", o->site.tls_name, "add: NAME of the certificate in that folder").shows_default();
  options.add("--certificate", o->site.certificate,
              "add: name that the site's certificate must vouch for; default: the host of its address");
  options.add("--timeout-s", o->timeout_s, "check: longest wait for each site, seconds")
      .within(0.01, 3600.0)
      .shows_default();
  options.flag("--names", o->names, "list: names alone, one a line");
  options.flag("--json", o->json, "print JSON, one value");
  return [o](std::stop_token stop) { return run(*o, std::move(stop)); };
}

}  // namespace telefab::client
