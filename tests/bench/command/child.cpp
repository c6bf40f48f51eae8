// SPDX-License-Identifier: GPL-3.0-or-later
#include "child.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <chrono>
#include <fstream>

extern char** environ;

namespace telefab::bench {

Result<Spent> run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                        const std::filesystem::path& output) {
  std::vector<std::string> words{program.string()};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const std::filesystem::path errors = output.string() + ".errors";
  constexpr int kMode = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, output.c_str(), kMode, 0600);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, errors.c_str(), kMode, 0600);
  const auto began = std::chrono::steady_clock::now();
  pid_t child = 0;
  const int failed = posix_spawn(&child, program.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (failed != 0) return fail(ErrorCode::Internal, fmt::format("{} does not start", program.string()));
  int status = 0;
  rusage used{};
  while (wait4(child, &status, 0, &used) < 0 && errno == EINTR) {
  }
  Spent spent;
  spent.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  spent.cpu_s = seconds(used.ru_utime) + seconds(used.ru_stime);
  spent.peak_MB = static_cast<double>(used.ru_maxrss) * 1.024e-3;
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return spent;
  std::string line, last;
  for (std::ifstream sentences{errors}; std::getline(sentences, line);)
    if (!line.empty()) last = line;
  return fail(ErrorCode::Internal,
              fmt::format("{} ended with status {}: {}", program.filename().string(), WEXITSTATUS(status), last));
}

}  // namespace telefab::bench
