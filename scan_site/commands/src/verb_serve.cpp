// SPDX-License-Identifier: GPL-3.0-or-later
#include <memory>
#include <telefab/scan/daemon/serve_scan_site.hpp>
#include <telefab/service/log.hpp>

#include "verbs.hpp"

namespace telefab::scan {

VerbBody declare_serve(VerbOptions& options) {
  auto o = std::make_shared<ScanSiteConfig>();
  o->serve = {"127.0.0.1:7410", "", "", "", "scan-site"};
  declare_serve_options(options, o->serve);
  add_address_or_none(options, "--fab", o->fab, "HOST:PORT of the fab site that prints the jobs; or --fleet");
  options.add("--fab-certificate", o->fab_certificate,
              "name that the fab's certificate must vouch for; default: the host of --fab");
  options.add(
      "--fleet", o->fleet.where,
      "queue of a fleet that prints the jobs, in place of one fab: sqlite:PATH for the daemons of one computer, "
      "or postgresql://USER@HOST/DATABASE?sslmode=verify-full (no password in it: a passfile has that)");
  options.add("--fleet-name", o->fleet.name,
              "name of this site in the fleet, that no other one has: 1 to 24 of a-z, 0-9 and -; the ids of its jobs "
              "begin with it");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto known = set_log_level(o->serve.log_level); !known) return tl::unexpected{known.error()};
    const SystemClock clock;
    if (auto served = serve_scan_site(*o, clock, std::move(stop)); !served) return tl::unexpected{served.error()};
    return ExitCode::Ok;
  };
}

}  // namespace telefab::scan
