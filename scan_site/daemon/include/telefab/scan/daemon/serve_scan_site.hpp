// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stop_token>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/service/fleet_link.hpp>
#include <telefab/service/serve_options.hpp>

namespace telefab::scan {

struct ScanSiteConfig {
  ServeOptions serve;
  std::string fab;              ///< HOST:PORT; empty: jobs are printed by a fleet
  std::string fab_certificate;  ///< name that the fab's certificate must vouch for; empty: the host of `fab`
  FleetMembership fleet;        ///< name: 1 to 24 characters; it begins the ids of the site's jobs
};

/// The daemon of the scan site, until the stop is requested. The calling thread is the network's. Fails as soon as
/// something is wrong with what it was given: machines, folder, certificates, port.
[[nodiscard]] Result<void> serve_scan_site(const ScanSiteConfig& config, const Clock& clock, std::stop_token stop);

}  // namespace telefab::scan
