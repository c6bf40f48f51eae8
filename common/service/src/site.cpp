// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/service/client_session.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/service_notifier.hpp>
#include <telefab/service/site.hpp>

#include <telefab/base/version.hpp>

namespace telefab {
namespace {

constexpr auto kReserveLookEvery = std::chrono::seconds{5};
constexpr auto kRetentionLookEvery = std::chrono::hours{1};
constexpr auto kBackUpEvery = std::chrono::hours{1};

}  // namespace

Result<std::unique_ptr<Site>> Site::open(std::string program, const ServeOptions& options, const Clock& clock,
                                         const Offering& offering) {
  auto profiles = known_profiles(options.machines);
  if (!profiles) return tl::unexpected{profiles.error()};
  auto offered =
      offering ? offering(std::move(profiles->catalogue)) : Result<ProfileCatalogue>{std::move(profiles->catalogue)};
  if (!offered) return tl::unexpected{offered.error()};
  auto folder = DataFolder::open(options.data);
  if (!folder) return tl::unexpected{folder.error()};
  std::unique_ptr<Site> site{new Site{std::move(program), options, clock, std::move(*offered), std::move(*folder)}};
  site->loop_ = std::make_unique<net::Loop>();
  site->room_ = std::make_unique<DiskRoom>(site->folder_.path(), options.reserve_mib << 20U, options.ask_space);
  auto tracker = JobTracker::open(site->folder_.path(), options.hooks, clock, *site->loop_, site->room_.get());
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
  look_after_reserve();
  backed_up_revision_ = store().revision();
  loop_->after(kBackUpEvery, [this] { back_up_store(); });
  if (options_.retention.is_on()) look_at_retention(work);

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

Result<Job> Site::forget(const std::string& job) {
  const auto found = store().find(job);
  if (!found) return found;
  if (!is_final(found->state))
    return fail(ErrorCode::Conflict,
                fmt::format("job {} is {}: only a job that has ended can be forgotten", job, name_of(found->state)));
  const auto taken = folder_.take_out(job);
  if (!taken) return tl::unexpected{taken.error()};
  auto forgotten = store().forget(job);
  if (!forgotten) {
    if (*taken)
      if (auto back = folder_.put_back(job, **taken); !back) log_warning(back.error().what, {job});
    return forgotten;
  }
  ended_bytes_.erase(job);
  std::error_code error;
  if (*taken) std::filesystem::remove_all(**taken, error);
  if (error) log_warning(fmt::format("{}: {}; the next start tries again", (*taken)->string(), error.message()), {job});
  return forgotten;
}

void Site::look_at_retention(SiteWork& work) {
  loop_->after(kRetentionLookEvery, [this, &work] { look_at_retention(work); });
  const auto ended = store().ended();
  if (!ended) return log_warning(ended.error().what);
  std::vector<std::string> unmeasured;  // a folder of a job that has ended does not change: once is enough
  if (options_.retention.keep_gib > 0)
    for (const Job& job : *ended)
      if (!ended_bytes_.contains(job.id)) unmeasured.push_back(job.id);
  measure(work, std::move(unmeasured));
}

void Site::measure(SiteWork& work, std::vector<std::string> jobs) {
  if (jobs.empty()) return forget_outlived(work);
  ended_bytes_[jobs.back()] = bytes_in(folder_.path() / "jobs" / jobs.back());
  jobs.pop_back();
  loop_->post([this, &work, jobs = std::move(jobs)] { measure(work, jobs); });
}

void Site::forget_outlived(SiteWork& work) {
  const auto ended = store().ended();
  if (!ended) return log_warning(ended.error().what);
  const auto now = std::chrono::duration_cast<std::chrono::milliseconds>(clock_.wall()).count();
  auto gone = outlived(*ended, ended_bytes_, options_.retention, now);
  std::reverse(gone.begin(), gone.end());  // the oldest is taken first, from the end
  forget(work, std::move(gone));
}

void Site::forget(SiteWork& work, std::vector<Outlived> gone) {
  if (gone.empty()) return;
  const Outlived each = std::move(gone.back());
  gone.pop_back();
  // One that is still worked on, or cannot be removed now, is looked at again in an hour.
  if (const auto forgotten = work.forget(each.job))
    tracker_->note("telefab", fmt::format("forget {}: {}", each.job, each.why));
  else
    log_warning(forgotten.error().what, {each.job});
  loop_->post([this, &work, gone = std::move(gone)] { forget(work, gone); });
}

void Site::back_up_store() {
  if (const std::uint64_t now = store().revision(); now != backed_up_revision_) {
    const auto kept = store().back_up();
    if (kept)
      backed_up_revision_ = now;
    else
      log_warning(kept.error().what);
  }
  loop_->after(kBackUpEvery, [this] { back_up_store(); });
}

void Site::look_after_reserve() {
  // What no reserve can be taken for is said by health(), and by whatever waits for room.
  if (!room_->health()) (void)room_->check(0);
  loop_->after(kReserveLookEvery, [this] { look_after_reserve(); });
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
