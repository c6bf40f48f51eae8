// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/command_line/options.hpp>
#include "site_client.hpp"

namespace telefab::client {

/// What every verb takes: --site, --tls, --json.
struct CommonOptions {
  std::string site;  ///< HOST:PORT, or a name of the site book; empty: its default, else this machine
  std::string tls_folder;
  std::string tls_name = "operator";
  std::string site_certificate;  ///< name that the site's certificate must vouch for; empty: the host of its address
  double timeout_s = 10;
  bool json = false;
};
void declare_common(VerbOptions& options, CommonOptions& common);

/// A text that is no id cannot name a job; said here, not by a site that takes it for a broken message. InvalidInput.
[[nodiscard]] Result<void> check_job_id(const std::string& job);

[[nodiscard]] Result<std::unique_ptr<SiteClient>> connect(const CommonOptions& common, std::stop_token stop);

}  // namespace telefab::client
