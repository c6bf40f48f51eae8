// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <syslog.h>
#include <systemd/sd-journal.h>

#include <array>
#include <cstdlib>
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

struct DaemonLog {
  std::shared_ptr<spdlog::logger> logger =
      std::make_shared<spdlog::logger>("telefab", std::make_shared<spdlog::sinks::stderr_sink_mt>());
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
