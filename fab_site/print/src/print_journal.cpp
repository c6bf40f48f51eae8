// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <telefab/fab/print/print_journal.hpp>

#include "print_record_json.hpp"

namespace telefab::fab {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::uint64_t kLargestJournal_bytes = 1u << 30;

tl::unexpected<Error> io_failed(std::string_view deed, const std::filesystem::path& path) {
  const int reason = errno;
  const ErrorCode code = reason == EACCES || reason == EPERM ? ErrorCode::NotPermitted
                         : reason == ENOENT                  ? ErrorCode::NotFound
                                                             : ErrorCode::StorageFailed;
  return fail(code, fmt::format("{} the print journal {}: {}", deed, path.string(), std::strerror(reason)));
}

class DiskJournalFile final : public JournalFile {
 public:
  DiskJournalFile(int fd, std::filesystem::path path) : fd_{fd}, path_{std::move(path)} {}
  ~DiskJournalFile() override { ::close(fd_); }

  Result<std::string> read_all() override {
    struct stat st {};
    if (::fstat(fd_, &st) != 0) return io_failed("looking at", path_);
    if (static_cast<std::uint64_t>(st.st_size) > kLargestJournal_bytes)
      return fail(ErrorCode::TooLarge, "the print journal " + path_.string() + " is above 1 GiB");
    std::string text(static_cast<std::size_t>(st.st_size), '\0');
    std::size_t got = 0;
    while (got < text.size()) {
      const ssize_t n = ::pread(fd_, text.data() + got, text.size() - got, static_cast<off_t>(got));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return io_failed("reading", path_);
      if (n == 0) break;
      got += static_cast<std::size_t>(n);
    }
    text.resize(got);
    return text;
  }

  Result<void> append(std::string_view text) override {
    while (!text.empty()) {
      const ssize_t n = ::write(fd_, text.data(), text.size());
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return io_failed("writing", path_);
      text.remove_prefix(static_cast<std::size_t>(n));
    }
    return {};
  }

  Result<void> sync() override {
    if (::fdatasync(fd_) != 0) return io_failed("syncing", path_);
    return {};
  }

  Result<void> truncate(std::uint64_t bytes) override {
    if (::ftruncate(fd_, static_cast<off_t>(bytes)) != 0) return io_failed("shortening", path_);
    return {};
  }

 private:
  int fd_;
  std::filesystem::path path_;
};

class MemoryJournalFile final : public JournalFile {
 public:
  Result<std::string> read_all() override { return text_; }
  Result<void> append(std::string_view text) override {
    text_ += text;
    return {};
  }
  Result<void> sync() override { return {}; }
  Result<void> truncate(std::uint64_t bytes) override {
    text_.resize(std::min<std::size_t>(text_.size(), bytes));
    return {};
  }

 private:
  std::string text_;
};

std::string checksum(std::string_view line) { return to_hex(digest_of(std::as_bytes(std::span{line}))).substr(0, 16); }

bool carries_record(JournalStep step) {
  return step == JournalStep::Exposed || step == JournalStep::Passed || step == JournalStep::DecidedExposed;
}

/// What may be lost by a crash without harm: a layer is found ready, lifted or empty again.
bool needs_sync(JournalStep step) {
  return step != JournalStep::Ready && step != JournalStep::Lifted && step != JournalStep::Passed;
}

/// One line: checksum of the rest, a space, JSON.
std::string line_of(const JournalEntry& e) {
  Json j{{"step", name_of(e.step)}, {"layer", e.layer.count()}, {"wall_ns", e.wall.count()}};
  if (e.step == JournalStep::Planned) j["plan_sha256"] = to_hex(e.plan);
  if (!e.by.empty()) j["by"] = e.by;
  if (carries_record(e.step)) j["made"] = layer_to_json(e.made);
  const std::string body = j.dump();
  return checksum(body) + " " + body + "\n";
}

std::optional<JournalEntry> entry_of(std::string_view line) {
  constexpr std::size_t kSum = 16;
  if (line.size() < kSum + 2 || line[kSum] != ' ') return std::nullopt;
  const std::string_view body = line.substr(kSum + 1);
  if (checksum(body) != line.substr(0, kSum)) return std::nullopt;
  try {
    const auto j = nlohmann::json::parse(body);
    JournalEntry e;
    const auto step = j.at("step").get<std::string>();
    bool known = false;
    for (int i = 0; i <= static_cast<int>(JournalStep::Stopped); ++i)
      if (name_of(static_cast<JournalStep>(i)) == step) {
        e.step = static_cast<JournalStep>(i);
        known = true;
      }
    if (!known) return std::nullopt;
    e.layer = LayerIndex{j.at("layer").get<std::uint32_t>()};
    e.wall = Nanoseconds{j.at("wall_ns").get<std::int64_t>()};
    if (e.step == JournalStep::Planned) {
      const auto plan = digest_from_hex(j.at("plan_sha256").get<std::string>());
      if (!plan) return std::nullopt;
      e.plan = *plan;
    }
    e.by = j.value("by", "");
    if (carries_record(e.step)) e.made = layer_from_json(j.at("made"));
    return e;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

}  // namespace

Result<std::unique_ptr<JournalFile>> open_journal_file(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0640);
  if (fd < 0) return io_failed("opening", path);
  auto file = std::make_unique<DiskJournalFile>(fd, path);
  const auto parent = path.has_parent_path() ? path.parent_path() : std::filesystem::path{"."};
  const int folder = ::open(parent.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return io_failed("opening the folder of", path);
  const int synced = ::fsync(folder);
  ::close(folder);
  if (synced != 0) return io_failed("syncing the folder of", path);
  return file;
}

std::unique_ptr<JournalFile> memory_journal_file() { return std::make_unique<MemoryJournalFile>(); }

Result<PrintJournal> PrintJournal::open(std::unique_ptr<JournalFile> file) {
  PrintJournal journal{std::move(file)};
  const auto text = journal.file_->read_all();
  if (!text) return tl::unexpected{text.error()};
  std::size_t good = 0;
  while (good < text->size()) {
    const std::size_t end = text->find('\n', good);
    if (end == std::string::npos) break;
    auto entry = entry_of(std::string_view{*text}.substr(good, end - good));
    if (!entry) break;
    journal.entries_.push_back(std::move(*entry));
    good = end + 1;
  }
  if (good != text->size()) {
    if (const auto cut = journal.file_->truncate(good); !cut) return tl::unexpected{cut.error()};
    if (const auto kept = journal.file_->sync(); !kept) return tl::unexpected{kept.error()};
  }
  journal.bytes_ = good;
  return journal;
}

ResumePoint PrintJournal::resume_point() const {
  ResumePoint point;
  for (const JournalEntry& e : entries_) switch (e.step) {
      case JournalStep::Exposing:
        point = {e.layer, true};
        break;
      case JournalStep::NotExposed:
      case JournalStep::DecidedAgain:
        point = {e.layer, false};
        break;
      case JournalStep::Exposed:
      case JournalStep::Passed:
      case JournalStep::DecidedExposed:
        point = {e.layer + LayerIndex{1}, false};
        break;
      case JournalStep::Planned:
      case JournalStep::Ready:
      case JournalStep::Lifted:
      case JournalStep::Finished:
      case JournalStep::Stopped:
        break;
    }
  return point;
}

bool PrintJournal::finished() const {
  return std::any_of(entries_.begin(), entries_.end(),
                     [](const JournalEntry& e) { return e.step == JournalStep::Finished; });
}

std::uint32_t PrintJournal::runs() const {
  return static_cast<std::uint32_t>(std::count_if(
      entries_.begin(), entries_.end(), [](const JournalEntry& e) { return e.step == JournalStep::Planned; }));
}

std::vector<LayerRecord> PrintJournal::layers() const {
  std::vector<LayerRecord> made;
  std::map<LayerIndex, std::string> decided;
  for (const JournalEntry& e : entries_) {
    if (e.step == JournalStep::DecidedAgain || e.step == JournalStep::DecidedExposed) {
      std::string& said = decided[e.layer];
      said += (said.empty() ? "" : "; ") + std::string{e.step == JournalStep::DecidedAgain ? "again: " : "exposed: "} +
              e.by;
    }
    if (!carries_record(e.step) || (!made.empty() && made.back().index >= e.layer)) continue;
    made.push_back(e.made);
    if (const auto said = decided.find(e.layer); said != decided.end()) made.back().decided = said->second;
  }
  return made;
}

Result<void> PrintJournal::belongs_to(const Digest& plan) const {
  for (const JournalEntry& e : entries_)
    if (e.step == JournalStep::Planned && e.plan != plan)
      return fail(ErrorCode::NotTrusted,
                  "the print journal belongs to another plan; a changed plan needs a new job, not a resumed one");
  return {};
}

Result<void> PrintJournal::write(const JournalEntry& entry) {
  if (broken_)
    return fail(ErrorCode::StorageFailed,
                "the print journal failed before; reopen it, what it holds decides how to go on");
  const std::string line = line_of(entry);
  if (const auto ok = file_->append(line); !ok) {
    // Half a line would hide everything written behind it.
    broken_ = !file_->truncate(bytes_);
    return ok;
  }
  bytes_ += line.size();
  if (needs_sync(entry.step))
    if (const auto ok = file_->sync(); !ok) {
      broken_ = true;  // the kernel may have dropped what it could not write; a second sync would lie
      return ok;
    }
  entries_.push_back(entry);
  return {};
}

}  // namespace telefab::fab
