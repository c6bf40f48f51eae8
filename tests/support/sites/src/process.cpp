// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <telefab/test/process.hpp>

namespace telefab::test {
namespace {

constexpr int kPatienceMs = 30'000;

}  // namespace

Process::Process(const std::vector<std::string>& command) {
  std::array<int, 2> out{};
  std::array<int, 2> err{};
  if (::pipe2(out.data(), O_CLOEXEC) != 0 || ::pipe2(err.data(), O_CLOEXEC) != 0) throw std::runtime_error{"pipe"};
  std::vector<char*> arguments;
  for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
  arguments.push_back(nullptr);
  pid_ = ::fork();
  if (pid_ == 0) {
    ::dup2(out[1], STDOUT_FILENO);
    ::dup2(err[1], STDERR_FILENO);
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
  }
  ::close(out[1]);
  ::close(err[1]);
  out_ = out[0];
  err_ = err[0];
}

Process::~Process() {
  if (pid_ > 0) {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  for (const int fd : {out_, err_})
    if (fd >= 0) ::close(fd);
}

bool Process::read_some() {
  std::array<pollfd, 2> both{{{out_, POLLIN, 0}, {err_, POLLIN, 0}}};
  if (out_ < 0 && err_ < 0) return false;
  if (::poll(both.data(), both.size(), kPatienceMs) <= 0) return false;
  std::array<char, 4096> buffer{};
  const auto take = [&](const pollfd& each, int& fd, std::string& into) {
    if (fd < 0 || each.revents == 0) return;
    const ssize_t got = ::read(fd, buffer.data(), buffer.size());
    if (got > 0) {
      into.append(buffer.data(), static_cast<std::size_t>(got));
    } else {
      ::close(fd);
      fd = -1;
    }
  };
  take(both[0], out_, output_);
  take(both[1], err_, errors_);
  return true;
}

std::string Process::read_line() {
  while (true) {
    const std::size_t end = output_.find('\n', lines_from_);
    if (end != std::string::npos) {
      const std::string line = output_.substr(lines_from_, end - lines_from_);
      lines_from_ = end + 1;
      return line;
    }
    if (!read_some()) return {};
  }
}

std::string Process::wait_for_error_line(const std::string& mark) {
  while (true) {
    for (std::size_t end; (end = errors_.find('\n', errors_from_)) != std::string::npos;) {
      const std::string line = errors_.substr(errors_from_, end - errors_from_);
      errors_from_ = end + 1;
      if (line.find(mark) != std::string::npos) return line;
    }
    if (!read_some()) return errors_;
  }
}

int Process::finish() {
  while (read_some()) {
  }
  int status = 0;
  if (out_ >= 0 || err_ >= 0) ::kill(pid_, SIGKILL);  // patience ended
  ::waitpid(pid_, &status, 0);
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

void Process::send_signal(int signal) const { ::kill(pid_, signal); }

Outcome run(const std::vector<std::string>& command) {
  Process process{command};
  const int code = process.finish();
  return {code, process.output(), process.errors()};
}

}  // namespace telefab::test
