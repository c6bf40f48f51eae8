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
  add_address(options, "--fab", o->fab, "HOST:PORT of the fab site").required();
  options.add("--fab-certificate", o->fab_certificate,
              "name that the fab's certificate must vouch for; default: the host of --fab");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto known = set_log_level(o->serve.log_level); !known) return tl::unexpected{known.error()};
    const SystemClock clock;
    if (auto served = serve_scan_site(*o, clock, std::move(stop)); !served) return tl::unexpected{served.error()};
    return ExitCode::Ok;
  };
}

}  // namespace telefab::scan
