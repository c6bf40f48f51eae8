// SPDX-License-Identifier: GPL-3.0-or-later
#include "common_options.hpp"

#include <fmt/format.h>
#include <telefab/base/nearest_name.hpp>
#include <telefab/base/text.hpp>

#include "site_book.hpp"

namespace telefab::client {
namespace {

constexpr const char* kLocalSite = "127.0.0.1:7410";

/// The options with address and certificates of a named site filled in; what the command line says counts first.
Result<CommonOptions> looked_up(CommonOptions common) {
  if (common.site.find(':') != std::string::npos) return common;
  const auto book = read_site_book(site_book_path());
  if (!book) return tl::unexpected{book.error()};
  const std::string name = common.site.empty() ? book->default_site : common.site;
  if (name.empty()) {
    common.site = kLocalSite;
    return common;
  }
  const SiteEntry* site = book->find(name);
  if (!site) {
    std::vector<std::string> names;
    for (const SiteEntry& each : book->sites) names.push_back(each.name);
    return fail(ErrorCode::InvalidInput,
                fmt::format("no site {0} is known{1}: use HOST:PORT, or `telefab sites add {0} --address HOST:PORT`",
                            name, names.empty() ? "" : "; " + names_instead(name, names, "`telefab sites`")));
  }
  common.site = site->address;
  if (common.tls_folder.empty()) {
    common.tls_folder = site->tls_folder;
    common.tls_name = site->tls_name;
  }
  if (common.site_certificate.empty()) common.site_certificate = site->certificate;
  return common;
}

/// An address, or what may be a name of the site book.
Result<void> site_from_text(const std::string& text) {
  if (text.find(':') == std::string::npos) return {};
  return net::endpoint_from_text(text).map([](const net::Endpoint&) {});
}

}  // namespace

void declare_common(VerbOptions& options, CommonOptions& common) {
  options
      .add("--site", common.site,
           "scan site (or fab site, to watch and approve there): HOST:PORT or a name of `telefab sites`; "
           "default: that of `telefab sites`, else 127.0.0.1:7410")
      .names("SITE")
      .read_by(site_from_text)
      .environment("TELEFAB_SITE");
  options
      .add("--tls", common.tls_folder,
           "folder with authority.crt, NAME.crt, NAME.key and revoked.crl, as `telefab certs` makes it; needed off "
           "loopback")
      .environment("TELEFAB_TLS");
  options.add("--tls-name", common.tls_name, "NAME of the certificate in that folder").shows_default();
  options
      .add("--site-certificate", common.site_certificate,
           "name that the site's certificate must vouch for; default: the host of its address")
      .environment("TELEFAB_SITE_CERTIFICATE");
  options.add("--timeout-s", common.timeout_s, "longest wait for a connection, seconds")
      .within(0.01, 3600.0)
      .shows_default();
  options.flag("--json", common.json, "print JSON, one value");
}

Result<void> check_job_id(const std::string& job) {
  if (is_job_id(job)) return {};
  return fail(ErrorCode::InvalidInput, fmt::format("no job {}: `telefab jobs` lists them", to_printable(job)));
}

Result<std::unique_ptr<SiteClient>> connect(const CommonOptions& given, std::stop_token stop) {
  const auto found = looked_up(given);
  if (!found) return tl::unexpected{found.error()};
  const CommonOptions& common = *found;
  auto endpoint = net::endpoint_from_text(common.site);
  if (!endpoint) return tl::unexpected{endpoint.error()};
  SiteAddress address{*endpoint, {}, {}};
  address.connect_within = Nanoseconds{static_cast<std::int64_t>(common.timeout_s * 1e9)};
  if (!common.tls_folder.empty()) {
    auto trust = net::Trust::load(net::tls_files_in(common.tls_folder, common.tls_name));
    if (!trust) return tl::unexpected{trust.error()};
    address.trust = std::move(*trust);
    address.expected_name = common.site_certificate.empty() ? endpoint->host : common.site_certificate;
  }
  return SiteClient::connect(address, std::move(stop));
}

}  // namespace telefab::client
