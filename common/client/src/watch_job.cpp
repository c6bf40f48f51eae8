// SPDX-License-Identifier: GPL-3.0-or-later
#include "watch_job.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <telefab/command_line/output.hpp>

#include "full_screen.hpp"
#include "job_text.hpp"
#include "watch_screen.hpp"

namespace telefab::client {
namespace {

constexpr auto kKeysEvery = std::chrono::milliseconds{100};
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
    write_note(fmt::format("{}{}{}\n", progress_text(job), job.message.empty() ? "" : ": ", job.message));
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

}  // namespace

Result<Job> watch_job(SiteClient& client, const std::string& job, WatchStyle style) {
  if (auto sent = client.send(AskJobs{client.next_request(), job, 1, true}); !sent) return tl::unexpected{sent.error()};
  if (style == WatchStyle::Screen && FullScreen::is_possible()) return watch_on_screen(client);
  return watch_lines(client, style == WatchStyle::Silent);
}

}  // namespace telefab::client
