// SPDX-License-Identifier: GPL-3.0-or-later
#include "watch_job.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <telefab/base/text.hpp>
#include <telefab/command_line/output.hpp>

#include "full_screen.hpp"
#include "job_text.hpp"
#include "watch_screen.hpp"

namespace telefab::client {
namespace {

constexpr auto kKeysEvery = std::chrono::milliseconds{100};
constexpr auto kTryEvery = std::chrono::milliseconds{500};
/// The connection's own pings tell whether the site lives; a job may be silent for hours.
constexpr auto kForever = std::chrono::hours{24 * 30};

/// The job of an answer to AskJobs.
Result<Job> job_in(const Message& received) {
  const auto* jobs = std::get_if<Jobs>(&received);
  if (!jobs || jobs->jobs.size() != 1)
    return fail(ErrorCode::ProtocolBroken, "the site sent something else than the job");
  return jobs->jobs.front();
}

/// A line for each new state or message, and for each tenth of a state.
class LineView {
 public:
  void show(const Job& job) {
    const int tenth = static_cast<int>(10 * progress_of(job));
    const std::string key = fmt::format("{}/{}/{}", static_cast<int>(job.state), job.message, tenth);
    if (key == last_) return;
    last_ = key;
    write_note(to_printable(fmt::format("{}{}{}", progress_text(job), job.message.empty() ? "" : ": ", job.message)) +
               "\n");
  }

 private:
  std::string last_;
};

Result<Job> watch_lines(SiteClient& client, bool is_silent) {
  LineView view;
  while (true) {
    auto received = client.receive(kForever);
    if (!received) return tl::unexpected{received.error()};
    auto job = job_in(*received);
    if (!job) return job;
    if (!is_silent) view.show(*job);
    if (is_final(job->state)) return job;
  }
}

std::string time_of_day(const Clock& clock) {
  return fmt::format("{:%H:%M:%S}",
                     fmt::localtime(std::chrono::duration_cast<std::chrono::seconds>(clock.wall()).count()));
}

Result<Job> watch_on_screen(SiteClient& client) {
  const SystemClock clock;
  WatchHistory history;
  FullScreen screen;
  while (true) {
    const FullScreen::Size size = screen.size();
    screen.show(watch_screen(history, size.columns, size.rows));
    for (char key = screen.key(); key != 0; key = screen.key())
      if ((key == 'q' || key == 'Q') && history.job()) return *history.job();
    auto received = client.receive_within(kKeysEvery);
    if (!received) return tl::unexpected{received.error()};
    if (!*received) continue;
    const auto job = job_in(**received);
    if (!job) return job;
    history.saw(*job, clock.now(), time_of_day(clock));
    if (is_final(job->state)) return job;
  }
}

Result<Job> watch_once(SiteClient& client, const std::string& job, WatchStyle style) {
  if (auto sent = client.send(AskJobs{client.next_request(), job, 1, true}); !sent) return tl::unexpected{sent.error()};
  if (style == WatchStyle::Screen && FullScreen::is_possible()) return watch_on_screen(client);
  return watch_lines(client, style == WatchStyle::Silent);
}

/// Tries until there is a connection again.
Result<std::unique_ptr<SiteClient>> connect_again(const WatchLine& line, Clock& clock) {
  const Nanoseconds until = clock.now() + Nanoseconds{static_cast<Nanoseconds::rep>(line.patience_min * 60e9)};
  while (true) {
    if (line.stop.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled");
    auto client = line.connect();
    if (client || client.error().code != ErrorCode::Unreachable || clock.now() >= until) return client;
    clock.sleep_for(kTryEvery);
  }
}

}  // namespace

void declare_patience(VerbOptions& options, double& patience_min) {
  options
      .add("--patience-min", patience_min, "minutes of trying again where the line to the site breaks; 0: not at all")
      .within(0.0, 1e5)
      .shows_default();
}

Result<Job> watch_job(std::unique_ptr<SiteClient> client, const WatchLine& line, const std::string& job,
                      WatchStyle style) {
  SystemClock clock;
  while (true) {
    auto seen = watch_once(*client, job, style);
    if (seen || seen.error().code != ErrorCode::Unreachable || line.patience_min <= 0) return seen;
    if (style != WatchStyle::Silent)
      write_note(fmt::format("the line to the site broke ({}); trying again\n", seen.error().what));
    auto again = connect_again(line, clock);
    if (!again) return tl::unexpected{again.error()};
    client = std::move(*again);
  }
}

}  // namespace telefab::client
