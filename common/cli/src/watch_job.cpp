#include "watch_job.hpp"

#include <fmt/format.h>
#include <telefab/program/program.hpp>

#include "job_text.hpp"

namespace telefab::cli {
namespace {

constexpr int kBarColumns = 30;

/// Shows a job's way on standard error.
class ProgressView {
 public:
  explicit ProgressView(bool quiet) : quiet_{quiet}, terminal_{on_terminal()} {}
  ~ProgressView() {
    if (drawn_) fmt::print(stderr, "\n");
  }
  ProgressView(const ProgressView&) = delete;
  ProgressView& operator=(const ProgressView&) = delete;

  void show(const Job& job) {
    if (quiet_) return;
    if (terminal_) return draw(job);
    // A line for each new state or message, and for each tenth of a state.
    const int tenth = static_cast<int>(10 * progress_of(job));
    const std::string key = fmt::format("{}/{}/{}", static_cast<int>(job.state), job.message, tenth);
    if (key == last_) return;
    last_ = key;
    fmt::print(stderr, "{}{}{}\n", progress_text(job), job.message.empty() ? "" : ": ", job.message);
  }

 private:
  void draw(const Job& job) {
    const int filled = static_cast<int>(kBarColumns * progress_of(job));
    fmt::print(stderr, "\r\x1b[K[{:#<{}}{:.<{}}] {}", "", filled, "", kBarColumns - filled, progress_text(job));
    std::fflush(stderr);
    drawn_ = true;
  }
  bool quiet_;
  bool terminal_;
  bool drawn_ = false;
  std::string last_;
};

}  // namespace

Result<Job> watch_job(SiteClient& client, const std::string& job, bool quiet) {
  ProgressView view{quiet};
  if (auto said = client.say(AskJobs{client.next_request(), job, 1, true}); !said) return tl::unexpected{said.error()};
  while (true) {
    // The connection's own pings tell whether the site lives; a job may be silent for hours.
    auto heard = client.hear(std::chrono::hours{24 * 30});
    if (!heard) return tl::unexpected{heard.error()};
    const auto* jobs = std::get_if<Jobs>(&*heard);
    if (!jobs || jobs->jobs.size() != 1)
      return fail(ErrorCode::ProtocolBroken, "the site sent something else than the job");
    view.show(jobs->jobs.front());
    if (is_final(jobs->jobs.front().state)) return jobs->jobs.front();
  }
}

}  // namespace telefab::cli
