// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <vector>

namespace telefab::scan {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kProgram = "telefab-fab";
constexpr int kLookEveryMs = 100;
/// What it prints is a line; more is another program's.
constexpr std::size_t kMostOutput = 1U << 20U;

bool is_program(const fs::path& path) {
  std::error_code unknown;
  return fs::is_regular_file(path, unknown) && ::access(path.c_str(), X_OK) == 0;
}

std::optional<fs::path> in_path(std::string_view name) {
  const char* const path = std::getenv("PATH");
  std::string_view rest = path ? path : "";
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(':'), rest.size());
    if (const fs::path candidate = fs::path{rest.substr(0, end)} / name; end > 0 && is_program(candidate))
      return candidate;
    rest.remove_prefix(std::min(rest.size(), end + 1));
  }
  return std::nullopt;
}

struct Ended {
  int status = 0;
  std::string output, errors;
};

/// Runs a program to its end; the output is read while it runs, so that it never waits for us.
Result<Ended> run(const std::string& program, std::vector<std::string> words, const std::stop_token& stop) {
  std::array<std::array<int, 2>, 2> pipes{{{-1, -1}, {-1, -1}}};
  const auto close_all = [&] {
    for (auto& pair : pipes)
      for (int& end : pair)
        if (end >= 0) ::close(std::exchange(end, -1));
  };
  for (auto& pair : pipes)
    if (::pipe2(pair.data(), O_CLOEXEC) != 0) {
      const int error = errno;
      close_all();
      return fail(ErrorCode::StorageFailed, fmt::format("cannot run {}: {}", program, std::strerror(error)));
    }
  posix_spawn_file_actions_t files{};
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&files, pipes[0][1], STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&files, pipes[1][1], STDERR_FILENO);
  posix_spawnattr_t attributes{};
  posix_spawnattr_init(&attributes);
  // A group of its own, to be ended whole; signals as a shell would leave them.
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  sigset_t signals;
  sigemptyset(&signals);
  posix_spawnattr_setsigmask(&attributes, &signals);
  sigaddset(&signals, SIGPIPE);
  posix_spawnattr_setsigdefault(&attributes, &signals);
  std::vector<char*> arguments;
  words.insert(words.begin(), program);
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  pid_t child = -1;
  const int error = ::posix_spawn(&child, program.c_str(), &files, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  for (auto& pair : pipes) ::close(std::exchange(pair[1], -1));
  if (error != 0) {
    close_all();
    return fail(ErrorCode::NotFound, fmt::format("cannot run {}: {}", program, std::strerror(error)));
  }
  Ended ended;
  std::array<std::string*, 2> texts{&ended.output, &ended.errors};
  while (pipes[0][0] >= 0 || pipes[1][0] >= 0) {
    if (stop.stop_requested()) ::kill(-child, SIGKILL);
    std::array<pollfd, 2> watched{{{pipes[0][0], POLLIN, 0}, {pipes[1][0], POLLIN, 0}}};
    if (::poll(watched.data(), watched.size(), kLookEveryMs) <= 0) continue;
    for (std::size_t i = 0; i < watched.size(); ++i) {
      if (watched[i].revents == 0) continue;
      std::array<char, 4096> bytes{};
      const ssize_t got = ::read(pipes[i][0], bytes.data(), bytes.size());
      if (got > 0 && texts[i]->size() < kMostOutput)
        texts[i]->append(bytes.data(), static_cast<std::size_t>(got));
      else if (got == 0 || (got < 0 && errno != EINTR && errno != EAGAIN))
        ::close(std::exchange(pipes[i][0], -1));
    }
  }
  ::waitpid(child, &ended.status, 0);
  if (stop.stop_requested()) return cancelled("planning supports");
  return ended;
}

}  // namespace

Result<std::optional<Planner>> Planner::find(const std::string& asked) {
  if (asked == "none") return std::nullopt;
  if (asked.empty()) {
    std::error_code unknown;
    if (const fs::path beside = fs::read_symlink("/proc/self/exe", unknown).parent_path() / kProgram;
        is_program(beside))
      return Planner{beside.string()};
    const auto found = in_path(kProgram);
    if (!found) return std::nullopt;
    return Planner{found->string()};
  }
  const auto found = asked.find('/') != std::string::npos
                         ? (is_program(asked) ? std::optional<fs::path>{asked} : std::nullopt)
                         : in_path(asked);
  if (!found)
    return fail(ErrorCode::NotFound, fmt::format("no program {} to plan supports; give its path, or none", asked));
  return Planner{found->string()};
}

Result<PlannedSupports> Planner::supports(const fs::path& stack, const std::string& machine, const fs::path& machines,
                                          unsigned threads, std::stop_token stop) const {
  const auto ended = run(program_,
                         {"supports", stack.string(), "--machine", machine, "--machines", machines.string(),
                          "--threads", std::to_string(threads), "--json"},
                         stop);
  if (!ended) return tl::unexpected{ended.error()};
  const auto refused = [&](std::string why) -> tl::unexpected<Error> {
    while (!why.empty() && why.back() == '\n') why.pop_back();
    return fail(ErrorCode::InvalidInput, fmt::format("{}: {}", program_, why));
  };
  if (!WIFEXITED(ended->status)) return refused(fmt::format("it died by signal {}", WTERMSIG(ended->status)));
  if (WEXITSTATUS(ended->status) != 0)
    return refused(ended->errors.empty() ? fmt::format("it ended with exit code {}", WEXITSTATUS(ended->status))
                                         : ended->errors);
  const auto figures = json_or_discarded(ended->output);
  const auto number = [&](const char* key) -> std::optional<double> {
    if (!figures.is_object() || !figures.contains(key) || !figures[key].is_number()) return std::nullopt;
    return figures[key].get<double>();
  };
  const auto support = number("support_mm3"), part = number("part_mm3"), anchors = number("anchors"),
             lifted = number("lifted_mm");
  if (!support || !part || !anchors || !lifted)
    return refused("what it printed are not the figures of supports; it is of another version");
  return PlannedSupports{*support, *part, static_cast<std::uint32_t>(*anchors), *lifted};
}

Result<WorkFolder> WorkFolder::make() {
  std::error_code error;
  std::string path = (fs::temp_directory_path(error) / "telefab-XXXXXX").string();
  if (error || ::mkdtemp(path.data()) == nullptr)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot make a folder {}: {}", path, error ? error.message() : std::strerror(errno)));
  return WorkFolder{path};
}

WorkFolder::~WorkFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace telefab::scan
