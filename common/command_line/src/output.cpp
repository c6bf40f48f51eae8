// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>
#include <string>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>

namespace telefab {
namespace {

constexpr std::size_t kKeptBack = 64U * 1024U;

/// Writes all of it; the error number where that fails, else 0.
int write_all(int file, std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(file, text.data(), text.size());
    if (written >= 0) {
      text.remove_prefix(static_cast<std::size_t>(written));
    } else if (errno == EAGAIN) {
      pollfd ready{file, POLLOUT, 0};  // somebody made the other end of the terminal non-blocking
      (void)::poll(&ready, 1, -1);
    } else if (errno != EINTR) {
      return errno;
    }
  }
  return 0;
}

/// Standard output, kept back until there is much of it; on a terminal until the line is whole.
class Output {
 public:
  void write(std::string_view text) {
    const std::scoped_lock lock{mutex_};
    if (error_ != 0) return;
    kept_ += text;
    if (kept_.size() >= kKeptBack || (is_terminal_ && kept_.ends_with('\n'))) hand_on();
  }
  /// The error number of the first text that could not be written, else 0.
  int flush() {
    const std::scoped_lock lock{mutex_};
    hand_on();
    return error_;
  }

 private:
  void hand_on() {
    if (error_ == 0) error_ = write_all(STDOUT_FILENO, kept_);
    kept_.clear();
  }
  std::mutex mutex_;
  std::string kept_;
  int error_ = 0;
  const bool is_terminal_ = ::isatty(STDOUT_FILENO) == 1;
};

Output& output() {
  static Output value;
  return value;
}

}  // namespace

void write_output(std::string_view text) { output().write(text); }

void write_note(std::string_view text) {
  output().flush();  // what was said first is seen first
  (void)write_all(STDERR_FILENO, text);
}

Result<void> flush_output() {
  const int error = output().flush();
  if (error == 0 || error == EPIPE) return {};
  return fail_system("write", "standard output", error);
}

bool is_output_read() { return output().flush() != EPIPE; }

void secure_standard_streams() {
  for (const int file : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(file, F_GETFD) == -1 && errno == EBADF)
      (void)::open("/dev/null", file == STDIN_FILENO ? O_RDONLY : O_WRONLY);  // takes the lowest number that is free
  ::signal(SIGPIPE, SIG_IGN);
}

}  // namespace telefab
