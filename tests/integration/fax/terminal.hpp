// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace telefab::test {

/// A program on a terminal of its own (a pty), with what it wrote and the settings it left.
class Terminal {
 public:
  Terminal(const std::vector<std::string>& command, unsigned short columns, unsigned short rows) {
    winsize size{};
    size.ws_col = columns;
    size.ws_row = rows;
    if (::openpty(&master_, &slave_, nullptr, nullptr, &size) != 0) std::abort();
    ::tcgetattr(slave_, &before_);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::setsid();
      ::ioctl(slave_, TIOCSCTTY, 0);
      for (const int fd : {0, 1, 2}) ::dup2(slave_, fd);
      ::setenv("TERM", "xterm", 1);
      std::vector<char*> words;
      for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
      words.push_back(nullptr);
      ::execv(words[0], words.data());
      ::_exit(127);
    }
  }
  ~Terminal() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
    ::close(master_);
    ::close(slave_);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  /// Reads until `mark` came after what was marked before, or ten seconds passed in silence.
  [[nodiscard]] bool wait_for(const std::string& mark) {
    while (true) {
      if (const auto at = written_.find(mark, from_); at != std::string::npos) {
        from_ = at + mark.size();
        return true;
      }
      pollfd input{master_, POLLIN, 0};
      if (::poll(&input, 1, 10'000) <= 0) return false;
      char buffer[4096];
      const ssize_t got = ::read(master_, buffer, sizeof buffer);
      if (got <= 0) return false;
      written_.append(buffer, static_cast<std::size_t>(got));
    }
  }
  void type(const std::string& keys) const { (void)!::write(master_, keys.data(), keys.size()); }
  void resize(unsigned short columns, unsigned short rows) const {
    winsize size{};
    size.ws_col = columns;
    size.ws_row = rows;
    ::ioctl(master_, TIOCSWINSZ, &size);
  }
  void send_signal(int signal) const { ::kill(pid_, signal); }
  /// The exit code, or minus the signal.
  [[nodiscard]] int finish() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  [[nodiscard]] bool is_as_before() const {
    termios now{};
    ::tcgetattr(slave_, &now);
    return now.c_lflag == before_.c_lflag && now.c_iflag == before_.c_iflag && now.c_cc[VSUSP] == before_.c_cc[VSUSP];
  }
  [[nodiscard]] const std::string& written() const { return written_; }

 private:
  int master_ = -1;
  int slave_ = -1;
  pid_t pid_ = -1;
  termios before_{};
  std::string written_;
  std::size_t from_ = 0;
};

}  // namespace telefab::test
