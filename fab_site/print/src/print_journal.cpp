// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <map>
#include <telefab/base/damaged_file.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/print/print_journal.hpp>
#include <utility>

#include "print_record_json.hpp"

namespace telefab::fab {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::uint64_t kLargestJournal_bytes = 1u << 30;
constexpr int kJournalFlags = O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC;
constexpr std::uint64_t kLayerRoom_bytes = 2048;    // a layer's five lines are below 1,500
constexpr std::uint64_t kOrdersRoom_bytes = 65536;  // words, faults and starts
constexpr std::string_view kPolicy = "policy";

tl::unexpected<Error> io_failed(std::string_view action, const std::filesystem::path& path) {
  return fail_system(fmt::format("{} the print journal", action), path, errno);
}

class DiskJournalFile final : public JournalFile {
 public:
  DiskJournalFile(int fd, std::filesystem::path path) : fd_{fd}, path_{std::move(path)} {}
  ~DiskJournalFile() override { ::close(fd_); }

  Result<std::string> read_all() override {
    struct stat st {};
    if (::fstat(fd_, &st) != 0) return io_failed("look at", path_);
    if (static_cast<std::uint64_t>(st.st_size) > kLargestJournal_bytes)
      return fail(ErrorCode::TooLarge, "the print journal " + path_.string() + " is above 1 GiB");
    std::string text(static_cast<std::size_t>(st.st_size), '\0');
    std::size_t got = 0;
    while (got < text.size()) {
      const ssize_t n = ::pread(fd_, text.data() + got, text.size() - got, static_cast<off_t>(got));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return io_failed("read", path_);
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
      if (n <= 0) return io_failed("write", path_);
      text.remove_prefix(static_cast<std::size_t>(n));
    }
    return {};
  }

  Result<void> sync() override {
    if (::fdatasync(fd_) != 0) return io_failed("sync", path_);
    return {};
  }

  Result<void> truncate(std::uint64_t bytes) override {
    if (::ftruncate(fd_, static_cast<off_t>(bytes)) != 0) return io_failed("shorten", path_);
    return {};
  }

  Result<void> set_aside(std::string_view text) override {
    const auto aside = name_for_damaged(path_);
    if (!aside) return tl::unexpected{aside.error()};
    std::error_code error;
    std::filesystem::create_hard_link(path_, *aside, error);
    if (error)
      return fail(ErrorCode::StorageFailed,
                  fmt::format("setting the print journal {} aside: {}", path_.string(), error.message()));
    if (auto written = write_file_atomically(path_, text); !written) return written;
    const int fd = ::open(path_.c_str(), kJournalFlags, 0640);
    if (fd < 0) return io_failed("open", path_);
    ::close(std::exchange(fd_, fd));
    return {};
  }

  Result<void> reserve(std::uint64_t bytes) override {
    struct stat st {};
    if (::fstat(fd_, &st) != 0) return io_failed("look at", path_);
    if (::fallocate(fd_, FALLOC_FL_KEEP_SIZE, st.st_size, static_cast<off_t>(bytes)) == 0) return {};
    if (errno == EOPNOTSUPP || errno == ENOSYS) return {};  // then a full disk ends the print, dark
    return io_failed("keep room for", path_);
  }

 private:
  int fd_;
  std::filesystem::path path_;
};

class MemoryJournalFile final : public JournalFile {
 public:
  MemoryJournalFile() : text_{own_} {}
  explicit MemoryJournalFile(std::string& bytes) : text_{bytes} {}
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
  Result<void> set_aside(std::string_view text) override {
    text_ = text;
    return {};
  }
  Result<void> reserve(std::uint64_t) override { return {}; }

 private:
  std::string own_;
  std::string& text_;
};

bool carries_record(JournalStep step) {
  return step == JournalStep::Exposed || step == JournalStep::Passed || step == JournalStep::DecidedTreatAsExposed;
}

/// What may be lost by a crash without harm: a layer is found ready or lifted again.
bool needs_sync(JournalStep step) { return step != JournalStep::Ready && step != JournalStep::Lifted; }

std::string body_of(const JournalEntry& e) {
  Json j{{"step", name_of(e.step)}, {"layer", e.layer.count()}, {"wall_ns", e.wall.count()}};
  if (e.step == JournalStep::Planned) j["plan_sha256"] = to_hex(e.plan);
  if (!e.by.empty()) j["by"] = e.by;
  if (!e.why.empty()) j["why"] = e.why;
  if (carries_record(e.step)) j["made"] = layer_to_json(e.made);
  if (e.attempt > 0) j["attempt"] = e.attempt;
  return json_text(j);
}

/// A line of version 0.1: half of the checksum's digits, a space, the same JSON.
std::optional<std::string> old_body(std::string_view line) {
  constexpr std::size_t kSum = 16;
  if (line.size() < kSum + 2 || line[kSum] != ' ') return std::nullopt;
  const std::string_view body = line.substr(kSum + 1);
  if (to_hex(digest_of(std::as_bytes(std::span{body}))).substr(0, kSum) != line.substr(0, kSum)) return std::nullopt;
  return std::string{body};
}

std::optional<JournalStep> step_of(std::string_view name) {
  for (int i = 0; i < kJournalSteps; ++i)
    if (name_of(static_cast<JournalStep>(i)) == name) return static_cast<JournalStep>(i);
  return std::nullopt;
}

std::optional<JournalEntry> entry_of(std::string_view body) {
  try {
    const auto j = parsed_json(body);
    JournalEntry e;
    const auto step = step_of(j.at("step").get<std::string>());
    if (!step) return std::nullopt;
    e.step = *step;
    e.layer = LayerIndex{whole_number<std::uint32_t>(j.at("layer"))};
    e.wall = Nanoseconds{whole_number<std::int64_t>(j.at("wall_ns"))};
    if (e.step == JournalStep::Planned) {
      const auto plan = digest_from_hex(j.at("plan_sha256").get<std::string>());
      if (!plan) return std::nullopt;
      e.plan = *plan;
    }
    e.by = j.value("by", "");
    e.why = j.value("why", "");
    if (carries_record(e.step)) e.made = layer_from_json(j.at("made"));
    if (j.contains("attempt")) e.attempt = whole_number<std::uint32_t>(j.at("attempt"));
    return e;
  } catch (const nlohmann::ordered_json::exception&) {
    return std::nullopt;
  }
}

LayerIndex after(LayerIndex layer) { return layer + LayerIndex{1}; }

/// What a line says about the next layer; nothing where it says nothing.
std::optional<ResumePoint> point_of(const JournalEntry& e) {
  switch (e.step) {
    case JournalStep::Exposing:
      return ResumePoint{e.layer, true};
    case JournalStep::Ready:
    case JournalStep::NotExposed:
    case JournalStep::DecidedExposeAgain:
      return ResumePoint{e.layer, false};
    case JournalStep::Exposed:
    case JournalStep::Passed:
    case JournalStep::DecidedTreatAsExposed:
      return ResumePoint{after(e.layer), false};
    default:
      return std::nullopt;
  }
}

std::string lost_text(const RecordDamage& damage) {
  if (damage.lost == 0) return fmt::format("{} bytes behind line {} are damaged", damage.bytes, damage.after);
  return fmt::format("{} of its lines behind line {} are lost", damage.lost, damage.after);
}

}  // namespace

Result<std::unique_ptr<JournalFile>> open_journal_file(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), kJournalFlags, 0640);
  if (fd < 0) return io_failed("open", path);
  auto file = std::make_unique<DiskJournalFile>(fd, path);
  if (auto synced = sync_folder_of(path); !synced) return fail_in("the print journal", synced.error());
  return file;
}

std::unique_ptr<JournalFile> memory_journal_file() { return std::make_unique<MemoryJournalFile>(); }

std::unique_ptr<JournalFile> memory_journal_file(std::string& bytes) {
  return std::make_unique<MemoryJournalFile>(bytes);
}

Result<PrintJournal> PrintJournal::open(std::unique_ptr<JournalFile> file) {
  PrintJournal journal{std::move(file)};
  const auto text = journal.file_->read_all();
  if (!text) return tl::unexpected{text.error()};
  RecordScan scan = scan_record_lines(*text, old_body);
  journal.damage_ = std::move(scan.damage);
  for (const RecordLine& record : scan.records) {
    auto entry = entry_of(record.body);
    // Whole, but of a newer version or another program: as unknown as a damaged one.
    if (!entry) {
      journal.damage_.push_back({0, record.body.size(), journal.entries_.size(), 1});
      continue;
    }
    journal.entries_.push_back(std::move(*entry));
  }
  if (scan.torn_bytes > 0 && journal.damage_.empty()) {
    if (const auto cut = journal.file_->truncate(scan.whole_bytes); !cut) return tl::unexpected{cut.error()};
    if (const auto kept = journal.file_->sync(); !kept) return tl::unexpected{kept.error()};
  }
  journal.bytes_ = scan.whole_bytes;
  return journal;
}

StandingOrder PrintJournal::order() const {
  StandingOrder standing;
  for (const JournalEntry& e : entries_) {
    const auto now = [&](Order order) { standing = {order, e.by, e.wall}; };
    switch (e.step) {
      case JournalStep::Approved:
      case JournalStep::Resumed:
        now(Order::GoOn);
        break;
      case JournalStep::DecidedExposeAgain:
      case JournalStep::DecidedTreatAsExposed:
        if (e.by != kPolicy && standing.order != Order::Cancel) now(Order::GoOn);
        break;
      case JournalStep::PauseAsked:
        now(Order::Pause);
        break;
      case JournalStep::CancelAsked:
      case JournalStep::Cancelled:
        if (standing.order != Order::Cancel) now(Order::Cancel);
        break;
      default:
        break;
    }
    if (standing.order == Order::Cancel) break;  // no word undoes it
  }
  return standing;
}

ResumePoint PrintJournal::resume_point() const {
  ResumePoint point;
  std::size_t known_at = 0;
  for (std::size_t k = 0; k < entries_.size(); ++k)
    if (const auto stated = point_of(entries_[k])) {
      point = *stated;
      known_at = k + 1;
    }
  // What was lost behind the last line that tells is in question: at most a layer for every three lines, and one begun.
  constexpr std::uint64_t kLinesALayer = 3;
  std::uint64_t lost = 0;
  for (const RecordDamage& d : damage_)
    if (d.after >= known_at) lost += std::max<std::uint64_t>(1, d.lost);
  if (lost > 0) {
    point.maybe_exposed = true;
    point.in_question = static_cast<std::uint32_t>(1 + lost / kLinesALayer);
  }
  return point;
}

bool PrintJournal::finished() const {
  return std::any_of(entries_.begin(), entries_.end(),
                     [](const JournalEntry& e) { return e.step == JournalStep::Finished; });
}

std::uint32_t PrintJournal::attempt() const {
  std::uint32_t newest = 0;
  for (const JournalEntry& e : entries_) newest = std::max(newest, e.attempt);
  return newest;
}

std::uint32_t PrintJournal::runs() const {
  return static_cast<std::uint32_t>(std::count_if(
      entries_.begin(), entries_.end(), [](const JournalEntry& e) { return e.step == JournalStep::Planned; }));
}

std::vector<LayerRecord> PrintJournal::layers() const {
  std::vector<LayerRecord> made;
  std::map<LayerIndex, std::string> decided;
  for (const JournalEntry& e : entries_) {
    if (e.step == JournalStep::DecidedExposeAgain || e.step == JournalStep::DecidedTreatAsExposed) {
      std::string& stated = decided[e.layer];
      stated += (stated.empty() ? "" : "; ") +
                std::string{e.step == JournalStep::DecidedExposeAgain ? "again: " : "exposed: "} + e.by;
    }
    if (!carries_record(e.step)) continue;
    made.push_back(e.made);
    if (const auto stated = decided.find(e.layer); stated != decided.end()) made.back().decided = stated->second;
  }
  return made;
}

std::vector<OrderRecord> PrintJournal::orders() const {
  std::vector<OrderRecord> orders;
  for (const JournalEntry& e : entries_)
    if (e.step == JournalStep::Approved || e.step == JournalStep::PauseAsked || e.step == JournalStep::Resumed ||
        e.step == JournalStep::CancelAsked || e.step == JournalStep::SetAside)
      orders.push_back({std::string{name_of(e.step)}, e.by, e.why, e.wall});
  return orders;
}

std::vector<std::string> PrintJournal::gaps() const {
  std::vector<std::string> gaps;
  for (const RecordDamage& d : damage_) gaps.push_back(lost_text(d));
  ResumePoint point;
  for (const JournalEntry& e : entries_) {
    if (e.step == JournalStep::SetAside) gaps.push_back(e.why);
    const auto stated = point_of(e);
    if (!stated) continue;
    if (e.step == JournalStep::Exposing && point.maybe_exposed)
      gaps.push_back(fmt::format("layer {} was exposed while layer {} was in question, and nobody had decided",
                                 e.layer.count(), point.next.count()));
    else if (e.layer < point.next && e.step != JournalStep::DecidedTreatAsExposed)
      gaps.push_back(fmt::format("layer {} comes again behind layer {}", e.layer.count(), point.next.count() - 1));
    else if (e.layer > point.next)
      gaps.push_back(fmt::format("layers {} to {} are missing in it", point.next.count(), e.layer.count() - 1));
    point = *stated;
  }
  return gaps;
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
  if (!damage_.empty())
    return fail(ErrorCode::NotTrusted, "the print journal is damaged: " + lost_text(damage_.front()) +
                                           "; an operator decides how the print goes on");
  if (entry.step == JournalStep::Exposing)
    if (const StandingOrder standing = order(); standing.order == Order::Pause || standing.order == Order::Cancel)
      return fail(ErrorCode::Conflict, fmt::format("layer {} is not exposed: {} asked to {} the print",
                                                   entry.layer.count(), standing.by.empty() ? "somebody" : standing.by,
                                                   standing.order == Order::Pause ? "pause" : "cancel"));
  if (entry.step == JournalStep::Planned || entry.step == JournalStep::Exposing)
    if (const std::uint32_t newest = attempt(); entry.attempt < newest)
      return fail(ErrorCode::Conflict,
                  fmt::format("the print journal is of attempt {}, and attempt {} is over", newest, entry.attempt));
  const std::string line = to_record_line(entries_.size() + 1, body_of(entry));
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

Result<void> PrintJournal::set_aside(std::string by, Nanoseconds wall, std::vector<JournalEntry> words) {
  std::vector<std::string> lost;
  for (const RecordDamage& d : damage_) lost.push_back(lost_text(d));
  std::vector<JournalEntry> entries = entries_;
  entries.push_back({JournalStep::SetAside,
                     resume_point().next,
                     wall,
                     {},
                     std::move(by),
                     {},
                     fmt::format("{}", fmt::join(lost, "; "))});
  std::move(words.begin(), words.end(), std::back_inserter(entries));
  std::string text;
  for (std::size_t k = 0; k < entries.size(); ++k) text += to_record_line(k + 1, body_of(entries[k]));
  if (auto done = file_->set_aside(text); !done) return done;
  entries_ = std::move(entries);
  damage_.clear();
  bytes_ = text.size();
  return {};
}

Result<void> PrintJournal::reserve(LayerIndex layers) { return file_->reserve(room_bytes(layers)); }

std::uint64_t PrintJournal::room_bytes(LayerIndex layers) {
  return layers.count() * kLayerRoom_bytes + kOrdersRoom_bytes;
}

}  // namespace telefab::fab
