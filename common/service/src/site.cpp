// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/command_line/machine_choice.hpp>
#include <telefab/service/client_session.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/service_notifier.hpp>
#include <telefab/service/site.hpp>

#include <telefab/base/version.hpp>

namespace telefab {

Result<std::unique_ptr<Site>> Site::open(std::string program, const ServeOptions& options, const Clock& clock) {
  auto machines = machine_profiles(options.machines);
  if (!machines) return tl::unexpected{machines.error()};
  auto folder = DataFolder::open(options.data);
  if (!folder) return tl::unexpected{folder.error()};
  std::unique_ptr<Site> site{
      new Site{std::move(program), options, clock, std::move(machines->machines), std::move(*folder)}};
  site->loop_ = std::make_unique<net::Loop>();
  auto tracker = JobTracker::open(site->folder_.path(), options.hooks, clock, *site->loop_);
  if (!tracker) return tl::unexpected{tracker.error()};
  site->tracker_ = std::move(*tracker);
  auto trust = trust_of(options);
  if (!trust) return tl::unexpected{trust.error()};
  site->trust_ = std::move(*trust);
  return site;
}

Result<FoundJob> Site::find(const std::string& job) {
  auto found = store().find(job);
  if (!found) return tl::unexpected{found.error()};
  auto folder = folder_.job(job);
  if (!folder) return tl::unexpected{folder.error()};
  return FoundJob{std::move(*found), std::move(*folder)};
}

Result<void> Site::serve(SiteWork& work, std::stop_token stop) {
  const auto left = store().unfinished();
  if (!left) return tl::unexpected{left.error()};
  for (const Job& job : *left) work.resume(job);

  // The page ends before the listener, and both before the work does.
  const auto listener = open_listener(
      *loop_, options_, trust_,
      [this, &work](const net::ConnectionPtr& connection) { on_connection(work, connection); },
      [this](std::string_view who, std::string_view what) { tracker_->note(who, what); });
  if (!listener) return tl::unexpected{listener.error()};
  const auto page = open_page_of(work);
  if (!page) return tl::unexpected{page.error()};
  listener_ = listener->get();

  set_thread_name("network");
  if (auto announced = folder_.announce_port((*listener)->port()); !announced) return announced;
  work.begin((*listener)->port());
  ServiceNotifier notifier;
  notifier.begin(*loop_, [&work] { return work.is_alive(); });
  // Until the work has ended the loop goes on, and feeds the watchdog.
  const std::stop_callback on_stop{
      stop, [this, &work] { loop_->post([this, &work] { work.end([this] { loop_->stop(); }); }); }};
  loop_->run();
  listener_ = nullptr;
  notifier.end();
  return {};
}

Result<std::unique_ptr<WebServer>> Site::open_page_of(SiteWork& work) {
  if (options_.web.empty()) return std::unique_ptr<WebServer>{};
  SignInEvents events;
  events.noted = [this](std::string_view who, std::string_view what) {
    loop_->post([this, who = std::string{who}, what = std::string{what}] { tracker_->note(who, what); });
  };
  events.refused = [this](const std::string& address, const Error& why) {
    loop_->post([this, address, why] {
      if (listener_ != nullptr) listener_->count_refusal(address, why);
    });
  };
  auto sign_in = sign_in_of(options_, folder_, clock_, std::move(events));
  if (!sign_in) return tl::unexpected{sign_in.error()};
  sign_in_.emplace(std::move(*sign_in));
  WebSite& pages =
      work.open_page(*sign_in_, [this, &work](const Command& asked, std::function<void(Result<Job>)> done) {
        loop_->post([this, &work, asked, done = std::move(done)] {
          tracker_->note(asked.who, fmt::format("{} {}", name_of(asked.command), asked.job));
          work.command(asked, done);
        });
      });
  return telefab::open_page(options_, folder_, pages, fmt::format("{}/{}", program_, kVersion), clock_);
}

void Site::on_connection(SiteWork& work, const net::ConnectionPtr& connection) {
  const std::weak_ptr<net::Connection> weak = connection;
  handshake(
      *loop_, connection, work.hello(),
      [this, &work, weak](const Hello& theirs) {
        const auto strong = weak.lock();
        if (!strong) return;
        if (theirs.side == Side::Client)
          serve_client(*loop_, strong, work, {});
        else
          work.on_site(strong);
      },
      [this, address = connection->peer().address](const Error& why) {
        if (listener_ != nullptr) listener_->count_refusal(address, why);
      });
}

}  // namespace telefab
