#include "common_options.hpp"

#include <CLI/CLI.hpp>

namespace telefab::cli {

void declare_common(CLI::App& options, CommonOptions& common) {
  options
      .add_option("--site", common.site, "HOST:PORT of the scan site (or of the fab site, to watch and approve there)")
      ->envname("TELEFAB_SITE")
      ->capture_default_str();
  options
      .add_option("--tls", common.tls_folder,
                  "folder with authority.crt, NAME.crt, NAME.key and revoked.crl, as deploy/certs makes it; needed off "
                  "loopback")
      ->envname("TELEFAB_TLS");
  options.add_option("--tls-name", common.tls_name, "NAME of the certificate in that folder")->capture_default_str();
  options.add_option("--timeout-s", common.timeout_s, "longest wait for a connection, seconds")
      ->check(CLI::Range(0.01, 3600.0))
      ->capture_default_str();
  options.add_flag("--json", common.json, "print JSON, one value");
}

Result<std::unique_ptr<SiteClient>> connect(const CommonOptions& common, std::stop_token stop) {
  auto endpoint = net::endpoint_from_text(common.site);
  if (!endpoint) return tl::unexpected{endpoint.error()};
  SiteAddress address{std::move(*endpoint), {}};
  address.connect_within = Nanoseconds{static_cast<std::int64_t>(common.timeout_s * 1e9)};
  if (!common.tls_folder.empty()) {
    auto trust = net::Trust::load(net::tls_files_in(common.tls_folder, common.tls_name));
    if (!trust) return tl::unexpected{trust.error()};
    address.trust = std::move(*trust);
  }
  return SiteClient::connect(address, std::move(stop));
}

}  // namespace telefab::cli
