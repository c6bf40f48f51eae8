// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <stop_token>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/fab/print/start_rule.hpp>
#include <telefab/service/fleet_link.hpp>
#include <telefab/service/serve_options.hpp>

namespace telefab::fab {

/// Who says that a platform is empty before the next part is begun on it.
enum class PlatformPolicy : std::uint8_t {
  ByMachine,          ///< an operator for real devices, nobody for virtual ones
  ClearedByOperator,  ///< an operator: `telefab cleared MACHINE`, the page, the API
  Automatic,          ///< nobody: a robot takes the parts off, or none is made
};

/// A fab as a member of a fleet.
struct FabMembership : FleetMembership {
  std::string address;      ///< HOST:PORT at which scan sites reach it; empty: that of --listen, with the port bound
  std::string certificate;  ///< name that its certificate vouches for; empty: the host of the address
};

struct FabSiteConfig {
  ServeOptions serve;
  std::string site_keys;           ///< folder with SITE.sign.pub; empty: the --tls folder, or none without TLS
  std::string instances;           ///< list of the machines that stand here; empty: one of each profile
  PlanOptions planning;            ///< of every job; name, registration and regions are its own
  bool start_on_approval = false;  ///< a planned job waits for `telefab approve`
  PlatformPolicy platform = PlatformPolicy::ByMachine;
  FabMembership fleet;
  StartPolicy at_start;  ///< what may light by itself when the site starts
};

/// The daemon of the fab site, until the stop is requested. The calling thread is the network's. Fails as soon as
/// something is wrong with what it was given: machines, folder, certificates, port.
[[nodiscard]] Result<void> serve_fab_site(const FabSiteConfig& config, const Clock& clock, std::stop_token stop);

}  // namespace telefab::fab
