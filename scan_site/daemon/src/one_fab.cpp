// SPDX-License-Identifier: GPL-3.0-or-later
#include "fab_route.hpp"

namespace telefab::scan {
namespace {

FabLinkEvents events_of(RouteEvents& events, const std::string& fab) {
  FabLinkEvents all = std::move(events.jobs);
  all.changed = [changed = std::move(events.changed), what = "the fab " + fab](bool is_up, const std::string& why) {
    changed(what, is_up, why);
  };
  return all;
}

}  // namespace

OneFab::OneFab(net::Loop& loop, net::ConnectOptions options, std::string site_key, RouteEvents events)
    : fab_{net::to_text(options.endpoint)},
      link_{loop, std::move(options), std::move(site_key), events_of(events, fab_)} {}

const ProfileCatalogue* OneFab::profiles() const { return link_.profiles() ? &*link_.profiles() : nullptr; }

void OneFab::machines(std::function<void(Result<std::vector<MachineStatus>>)> done) {
  if (!link_.is_up()) return done(fail(ErrorCode::Unreachable, "the fab is not reached: " + link_.why_down()));
  if (!link_.answers_machines())
    return done(fail(ErrorCode::NotFound, "the fab is of a release that does not tell what its machines are at"));
  const RequestId request = link_.next_request();
  link_.ask(request, AskMachines{request}, [done = std::move(done)](Result<Message> answer) {
    if (auto* theirs = answer ? std::get_if<Machines>(&*answer) : nullptr)
      done(std::move(theirs->standing));
    else
      done(answer ? fail(ErrorCode::ProtocolBroken, "the fab answered with another message")
                  : tl::unexpected{answer.error()});
    return true;
  });
}

void OneFab::cancel(const std::string& job, const std::string& who, std::function<void(Result<void>)> done) {
  cancel_at({&link_, job}, who, std::move(done));
}

void cancel_at(const FabRoute::AtFab& fab, const std::string& who, std::function<void(Result<void>)> done) {
  const RequestId request = fab.link->next_request();
  fab.link->ask(
      request, Command{request, fab.id, JobCommand::Cancel, who},
      [done = std::move(done)](const Result<Message>& answer) {
        // NotFound and Conflict are as good as yes: there is nothing left to cancel.
        if (answer || answer.error().code == ErrorCode::NotFound || answer.error().code == ErrorCode::Conflict)
          done({});
        else
          done(tl::unexpected{answer.error()});
        return true;
      });
}

}  // namespace telefab::scan
