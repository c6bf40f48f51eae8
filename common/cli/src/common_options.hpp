#pragma once
#include "site_client.hpp"

namespace CLI {
class App;
}

namespace telefab::cli {

/// What every verb takes: --site, --tls, --json.
struct CommonOptions {
  std::string site = "127.0.0.1:7410";
  std::string tls_folder;
  std::string tls_name = "operator";
  double timeout_s = 10;
  bool json = false;
};
void declare_common(CLI::App& options, CommonOptions& common);

[[nodiscard]] Result<std::unique_ptr<SiteClient>> connect(const CommonOptions& common, std::stop_token stop);

}  // namespace telefab::cli
