// SPDX-License-Identifier: GPL-3.0-or-later
#include "accuracy.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <telefab/service/data_folder.hpp>
#include <vector>

namespace telefab::fab {
namespace {

constexpr int kLookEveryMs = 200;
constexpr int kLowPriority = 15;
constexpr int kNotStarted = 127;

pid_t spawn(std::vector<std::string> words) {
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  sigset_t none;
  sigemptyset(&none);
  const pid_t daemon = ::getpid();
  const pid_t child = ::fork();
  if (child != 0) return child;
  // From here to the exec only what signal-safety(7) allows: other threads may hold any lock. First it lets go of every
  // lock, socket, journal and device of the daemon, which the next start wants if this one is killed now.
  ::close_range(STDERR_FILENO + 1, ~0U, 0);
  // The child ends with the thread that waits for it, however that ends; a daemon that was killed leaves nothing
  // running.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != daemon) ::_exit(kNotStarted);
  ::setpgid(0, 0);
  const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  ::dup2(nothing, STDIN_FILENO);
  ::dup2(nothing, STDOUT_FILENO);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  ::execv("/proc/self/exe", arguments.data());
  ::_exit(kNotStarted);
}

}  // namespace

Result<void> keep_accuracy(const std::filesystem::path& job_folder, const ProfileChoice& printed_with,
                           const std::string& machine_folder, const std::stop_token& stop) {
  const auto report = job_folder / "report";
  if (auto made = make_folder(report); !made) return made;
  std::vector<std::string> words{"telefab-fab",
                                 "predict",
                                 (job_folder / "plan").string(),
                                 "--machine",
                                 printed_with.machine,
                                 "--machines",
                                 machine_folder,
                                 "--report",
                                 (report / "accuracy.json").string(),
                                 "--preview",
                                 (report / "accuracy.png").string(),
                                 "--spacing-px",
                                 "2",
                                 "--threads",
                                 "1",
                                 "--force"};
  if (!printed_with.resin.empty()) words.insert(words.end(), {"--resin", printed_with.resin});
  if (!printed_with.print.empty()) words.insert(words.end(), {"--print", printed_with.print});
  const pid_t child = spawn(std::move(words));
  if (child < 0) return fail(ErrorCode::Internal, "the process for it could not be started");
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(child), kLowPriority);
  std::ofstream{fmt::format("/proc/{}/oom_score_adj", child)} << 1000;
  const int watch = static_cast<int>(::syscall(SYS_pidfd_open, child, 0));
  bool has_ended = false;
  while (!has_ended && !stop.stop_requested()) {
    pollfd each{watch, POLLIN, 0};
    has_ended = ::poll(&each, 1, kLookEveryMs) > 0;
  }
  if (!has_ended) ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  if (watch >= 0) ::close(watch);
  if (!has_ended) return fail(ErrorCode::Cancelled, "it was not waited for");
  if (WIFSIGNALED(status))
    return fail(ErrorCode::Internal, fmt::format("the process for it died by signal {}", WTERMSIG(status)));
  if (WEXITSTATUS(status) != 0)
    return fail(ErrorCode::Internal, fmt::format("the process for it ended with exit code {}", WEXITSTATUS(status)));
  return {};
}

}  // namespace telefab::fab
