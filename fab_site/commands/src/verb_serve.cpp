// SPDX-License-Identifier: GPL-3.0-or-later
#include <map>
#include <memory>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/service/log.hpp>

#include "contour_limit_options.hpp"
#include "mask_options.hpp"
#include "verbs.hpp"

namespace telefab::fab {

VerbBody declare_serve(VerbOptions& options) {
  struct Options {
    FabSiteConfig config;
    std::string start = "automatic";
    std::string after_crash = "ask";
    std::string after_restart = "go-on";
    double within_min = 10;
    std::string platform = "by-machine";
    MaskOptions masks;
    ContourLimitOptions contour_limits;
  };
  auto o = std::make_shared<Options>();
  o->config.serve = {"127.0.0.1:7420", "", "", "", "fab-site"};
  declare_serve_options(options, o->config.serve);
  options.add("--site-keys", o->config.site_keys,
              "folder with SITE.sign.pub of every scan site whose jobs are taken; jobs not signed with one of "
              "them are refused. Default: the --tls folder; without TLS, on loopback only, every job is taken");
  options.add(
      "--instances", o->config.instances,
      "TOML file with a [[machine]] for each machine that stands here: name, profile, and where they are its own "
      "resin, print and [machine.devices]. Each has its own queue and prints beside the others; two may not have "
      "one device. Default: one machine of each profile, named as it is");
  options.add("--start", o->start, "automatic | on-approval: whether a planned job waits for `telefab approve`")
      .one_of({"automatic", "on-approval"})
      .shows_default();
  options
      .add("--after-crash", o->after_crash,
           "ask | treat-as-exposed | expose-again: what becomes of a layer that was perhaps exposed when the print "
           "broke off; "
           "ask waits for an operator (telefab resume --as)")
      .one_of({"treat-as-exposed", "expose-again", "ask"})
      .shows_default();
  options
      .add("--after-restart", o->after_restart,
           "go-on | ask: whether a print that broke off with the site goes on by itself at the next start. "
           "Paused and faulted ones, and those of a journal that does not fit, always wait for `telefab resume`")
      .one_of({"go-on", "ask"})
      .shows_default();
  options
      .add("--go-on-within-min", o->within_min,
           "minutes after which a print that broke off, or a job that waits in the queue, no longer goes on by itself")
      .within(0.0, 1e6)
      .shows_default();
  options
      .add("--platform", o->platform,
           "cleared-by-operator | automatic | by-machine: whether the next job waits until an operator says that the "
           "last part is off the platform (telefab cleared MACHINE); by-machine: for real devices alone")
      .one_of({"cleared-by-operator", "automatic", "by-machine"})
      .shows_default();
  options.add(
      "--fleet", o->config.fleet.where,
      "queue of a fleet, whose jobs are printed here beside the fab's own: sqlite:PATH for the daemons of one "
      "computer, or postgresql://USER@HOST/DATABASE?sslmode=verify-full (no password in it: a passfile has that). "
      "Without it the prints go on, and no new job comes from the fleet");
  options.add("--fleet-name", o->config.fleet.name,
              "name of this fab in the fleet, that no other one has: 1 to 64 of a-z, 0-9 and -; its machines are "
              "NAME-MACHINE there");
  options.add("--fleet-address", o->config.fleet.address,
              "HOST:PORT at which the scan sites of the fleet reach this fab; default: that of --listen");
  options.add("--fleet-certificate", o->config.fleet.certificate,
              "name that this fab's certificate vouches for, as the scan sites are to check it; default: the host of "
              "--fleet-address");
  declare_mask_options(options, o->masks);
  declare_contour_limits(options, o->contour_limits);
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto ok = apply(o->masks, o->config.planning); !ok) return tl::unexpected{ok.error()};
    o->config.planning.contour_limits = o->contour_limits.limits();
    o->config.start_on_approval = o->start == "on-approval";
    if (o->platform == "cleared-by-operator") o->config.platform = PlatformPolicy::ClearedByOperator;
    if (o->platform == "automatic") o->config.platform = PlatformPolicy::Automatic;
    StartPolicy& at_start = o->config.at_start;
    if (o->after_crash == "treat-as-exposed") at_start.maybe_exposed = Decision::TreatAsExposed;
    if (o->after_crash == "expose-again") at_start.maybe_exposed = Decision::ExposeAgain;
    at_start.go_on = o->after_restart == "go-on";
    at_start.within =
        std::chrono::duration_cast<Nanoseconds>(std::chrono::duration<double, std::ratio<60>>{o->within_min});
    if (auto known = set_log_level(o->config.serve.log_level); !known) return tl::unexpected{known.error()};
    const SystemClock clock;
    if (auto served = serve_fab_site(o->config, clock, std::move(stop)); !served) return tl::unexpected{served.error()};
    return ExitCode::Ok;
  };
}

}  // namespace telefab::fab
