// SPDX-License-Identifier: GPL-3.0-or-later
#include "watch_screen.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <telefab/base/text.hpp>
#include <telefab/job/machine_status.hpp>

#include "job_text.hpp"

namespace telefab::client {
namespace {

constexpr std::size_t kMostChanges = 200;
constexpr int kNameColumns = 16;
constexpr int kCountColumns = 26;
constexpr int kWidestBar = 60;
constexpr int kIndent = 2;

std::uint32_t done_of(const Job& job) {
  const JobCounters& c = job.counters;
  switch (job.state) {
    case JobState::Slicing:
      return c.layers_sliced;
    case JobState::Sending:
      return c.layers_sent;
    case JobState::Planning:
      return c.layers_planned;
    default:
      return c.layers_printed;
  }
}

std::uint32_t all_of(const Job& job) {
  return job.state == JobState::Slicing || job.state == JobState::Sending ? job.counters.layers
                                                                          : job.counters.print_layers;
}

/// At most `columns` characters of UTF-8; what would steer the terminal is shown as '?'.
std::string fitted(const std::string& text, int columns) {
  std::string out;
  int used = 0;
  for (const char c : to_printable(text)) {
    const bool continues = (static_cast<unsigned char>(c) & 0xC0U) == 0x80U;
    if (!continues && used++ >= columns) break;
    out += c;
  }
  return out;
}

/// A text on as many lines as it needs, broken at blanks; a word longer than a line is cut into pieces.
std::vector<std::string> wrapped(std::string_view text, int columns) {
  const auto width = static_cast<std::size_t>(std::max(columns, 1));
  const auto characters = [](std::string_view part) {
    return static_cast<std::size_t>(
        std::ranges::count_if(part, [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
  };
  std::vector<std::string> lines{""};
  const auto put = [&](std::string_view word) {
    const std::size_t used = characters(lines.back());
    if (used > 0 && used + 1 + characters(word) > width) lines.emplace_back();
    if (!lines.back().empty()) lines.back() += ' ';
    for (const char c : word) {
      const bool begins = (static_cast<unsigned char>(c) & 0xC0U) != 0x80U;
      if (begins && characters(lines.back()) == width) lines.emplace_back();
      lines.back() += c;
    }
  };
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(' '), text.size());
    if (end > 0)
      put(text.substr(0, end));
    else if (const std::size_t used = characters(lines.back()); used > 0 && used < width)
      lines.back() += ' ';  // of several blanks
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

std::string bar_line(std::string_view name, std::uint32_t done, std::uint32_t all, std::string_view after,
                     int columns) {
  const int width = std::clamp(columns - kNameColumns - kCountColumns - 4, 0, kWidestBar);
  const double share = all == 0 ? 0 : std::min(1.0, static_cast<double>(done) / all);
  const int filled = static_cast<int>(share * width);
  const std::string count = all == 0 ? std::string{"not yet"} : fmt::format("{} of {}", done, all);
  return fmt::format("  {:<{}}{:#<{}}{:.<{}}  {}{}", name, kNameColumns, "", filled, "", width - filled, count, after);
}

}  // namespace

void WatchHistory::saw(const Job& job, Nanoseconds now, const std::string& time_of_day) {
  const bool is_news = !job_ || job_->state != job.state || job_->message != job.message;
  if (is_news) {
    changes_.push_back(
        fmt::format("{}  {}{}{}", time_of_day, name_of(job.state), job.message.empty() ? "" : ": ", job.message));
    if (changes_.size() > kMostChanges) changes_.pop_front();
    first_done_ = done_of(job);
    first_ = now;
  }
  last_ = now;
  job_ = job;
}

std::optional<double> WatchHistory::seconds_left() const {
  if (!job_ || is_final(job_->state) || job_->state == JobState::Paused) return std::nullopt;
  const std::uint32_t done = done_of(*job_), all = all_of(*job_);
  const double passed_s = std::chrono::duration<double>(last_ - first_).count();
  if (done < first_done_ + 3 || all <= done || passed_s <= 0) return std::nullopt;
  return passed_s * (all - done) / (done - first_done_);
}

std::vector<std::string> watch_screen(const WatchHistory& history, int columns, int rows) {
  std::vector<std::string> lines;
  const auto add = [&](const std::string& line) { lines.push_back(fitted(line, columns)); };
  if (const auto& seen = history.job()) {
    const Job& job = *seen;
    const JobCounters& c = job.counters;
    add(fmt::format("Telefab  {}", job.name));
    add(fmt::format("job {} for {}, from {}", job.id, machine_text(job), job.owner));
    add("");
    struct Stage {
      const char* name;
      JobStage seconds;
      std::uint32_t done;
      std::uint32_t all;
    };
    for (const Stage& stage : std::array{Stage{"cut", JobStage::Slice, c.layers_sliced, c.layers},
                                         Stage{"kept by the fab", JobStage::Send, c.layers_sent, c.layers},
                                         Stage{"planned", JobStage::Plan, c.layers_planned, c.print_layers},
                                         Stage{"printed", JobStage::Print, c.layers_printed, c.print_layers}}) {
      std::string after;
      for (const StageSeconds& known : job.stages)
        if (known.stage == stage.seconds) after = fmt::format(", {}", duration_text(known.seconds));
      add(bar_line(stage.name, stage.done, stage.all, after, columns));
    }
    add("");
    const auto left = history.seconds_left();
    add(fmt::format("{}{}", progress_text(job), left ? fmt::format(", about {} left", duration_text(*left)) : ""));
    if (!job.message.empty())
      for (const std::string& line : wrapped(job.message, columns)) add(line);
    if (c.scan_bytes > 0)
      add(fmt::format("{} bytes crossed the wire for a scan of {} bytes", c.wire_bytes, c.scan_bytes));
    add("");
    // As many of the newest changes as there is room for, above the last line.
    const auto room = static_cast<std::size_t>(std::max(0, rows - static_cast<int>(lines.size()) - 2));
    std::vector<std::string> changes;
    for (const std::string& change : history.changes())
      for (const std::string& line : wrapped(change, columns - kIndent)) changes.push_back(line);
    for (std::size_t i = changes.size() - std::min(room, changes.size()); i < changes.size(); ++i)
      add(std::string(kIndent, ' ') + changes[i]);
  } else {
    add("Telefab: waiting for the site");
  }
  lines.resize(static_cast<std::size_t>(std::max(rows, 1)));
  lines.back() = fitted("q leaves; the job goes on", columns);
  return lines;
}

std::string screen_update(const std::vector<std::string>& before, const std::vector<std::string>& after) {
  std::string out;
  for (std::size_t row = 0; row < after.size(); ++row)
    if (row >= before.size() || before[row] != after[row])
      out += fmt::format("\x1b[{};1H{}\x1b[K", row + 1, after[row]);
  return out;
}

}  // namespace telefab::client
