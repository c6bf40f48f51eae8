// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <sys/types.h>

#include <string>
#include <vector>

namespace telefab::test {

/// A child process with its standard output and standard error on pipes. Killed at destruction where it still runs.
class Process {
 public:
  explicit Process(const std::vector<std::string>& command);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// The next line of standard output; empty at its end or after `kPatienceSeconds` without one.
  [[nodiscard]] std::string read_line();
  /// Reads standard error until a line contains `mark`; that line, or everything read when the end came first.
  [[nodiscard]] std::string wait_for_error_line(const std::string& mark);
  /// Reads both to their ends and waits; the exit code, or minus the signal.
  [[nodiscard]] int finish();
  void send_signal(int signal) const;
  [[nodiscard]] pid_t id() const { return pid_; }
  [[nodiscard]] const std::string& output() const { return output_; }
  [[nodiscard]] const std::string& errors() const { return errors_; }

 private:
  /// Waits until one of the pipes has bytes and takes them; false when both ended or patience did.
  bool read_some();
  pid_t pid_ = -1;
  int out_ = -1;
  int err_ = -1;
  std::string output_;
  std::string errors_;
  std::size_t lines_from_ = 0;
  std::size_t errors_from_ = 0;
};

struct Outcome {
  int code = -1;
  std::string output;
  std::string errors;
};
/// Runs a command to its end.
[[nodiscard]] Outcome run(const std::vector<std::string>& command);

}  // namespace telefab::test
