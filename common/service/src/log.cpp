// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <limits.h>
#include <poll.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <syslog.h>
#include <systemd/sd-journal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <mutex>
#include <string>
#include <telefab/service/log.hpp>

namespace telefab {
namespace {

/// systemd names the journal's socket by device and inode; a redirected standard error is another file.
bool is_journal(int descriptor) {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat status {};
  return stream && ::fstat(descriptor, &status) == 0 && fmt::format("{}:{}", status.st_dev, status.st_ino) == stream;
}

/// Standard error, for a daemon that must never wait for whoever reads it: a line that finds a full pipe is left out,
/// and the next that finds room says how many were. A pipe that poll() calls writable takes PIPE_BUF bytes at once.
class StandardErrorSink final : public spdlog::sinks::base_sink<std::mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    if (left_out_ > 0) {
      const std::string gap = fmt::format("{} lines were left out here: nobody read standard error\n", left_out_);
      if (!write(gap)) return void(++left_out_);
      left_out_ = 0;
    }
    if (!write({line.data(), line.size()})) ++left_out_;
  }
  void flush_() override {}

 private:
  static bool write(std::string_view text) {
    while (!text.empty()) {
      pollfd stream{STDERR_FILENO, POLLOUT, 0};
      if (::poll(&stream, 1, 0) <= 0 || (stream.revents & POLLOUT) == 0) return false;
      const ssize_t put = ::write(STDERR_FILENO, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
      if (put < 0 && errno == EINTR) continue;
      if (put <= 0) return false;
      text.remove_prefix(static_cast<std::size_t>(put));
    }
    return true;
  }
  std::uint64_t left_out_ = 0;
};

struct DaemonLog {
  std::shared_ptr<spdlog::logger> logger =
      std::make_shared<spdlog::logger>("telefab", std::make_shared<StandardErrorSink>());
  bool to_journal = is_journal(STDERR_FILENO);
  DaemonLog() { logger->set_pattern("%Y-%m-%d %H:%M:%S.%e %l %v"); }
};

DaemonLog& daemon_log() {
  static DaemonLog log;
  return log;
}

int journal_priority(spdlog::level::level_enum level) {
  if (level == spdlog::level::debug) return LOG_DEBUG;
  return level == spdlog::level::warn ? LOG_WARNING : LOG_INFO;
}

void write(spdlog::level::level_enum level, std::string_view text, const LogFields& fields) {
  DaemonLog& log = daemon_log();
  if (!log.logger->should_log(level)) return;
  if (!log.to_journal) return log.logger->log(level, "{}", text);
  std::array<std::string, 4> lines{
      fmt::format("MESSAGE={}", text), fmt::format("PRIORITY={}", journal_priority(level)), {}, {}};
  int count = 2;
  if (!fields.job.empty()) lines[count++] = fmt::format("JOB={}", fields.job);
  if (fields.layer >= 0) lines[count++] = fmt::format("LAYER={}", fields.layer);
  std::array<iovec, 4> parts{};
  for (int i = 0; i < count; ++i) parts[i] = {lines[i].data(), lines[i].size()};
  // Where the journal is gone, standard error still is somebody's.
  if (::sd_journal_sendv(parts.data(), count) < 0) log.logger->log(level, "{}", text);
}

}  // namespace

void log_line(std::string_view text, const LogFields& fields) { write(spdlog::level::info, text, fields); }
void log_warning(std::string_view text, const LogFields& fields) { write(spdlog::level::warn, text, fields); }
void log_detail(std::string_view text, const LogFields& fields) { write(spdlog::level::debug, text, fields); }

Result<void> set_log_level(std::string_view name) {
  static constexpr std::array levels{std::pair{std::string_view{"debug"}, spdlog::level::debug},
                                     std::pair{std::string_view{"info"}, spdlog::level::info},
                                     std::pair{std::string_view{"warning"}, spdlog::level::warn}};
  for (const auto& [known, level] : levels)
    if (name == known) {
      daemon_log().logger->set_level(level);
      return {};
    }
  return fail(ErrorCode::InvalidInput, fmt::format("{} is not a log level; there are: debug, info, warning", name));
}

}  // namespace telefab
