// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <telefab/fab/print/print_machine.hpp>
#include <telefab/fab/print/print_record.hpp>

namespace telefab::fab {

/// The bytes below a journal: an append-only file whose tail may be lost by a crash until it is synced.
class JournalFile {
 public:
  virtual ~JournalFile() = default;
  JournalFile(const JournalFile&) = delete;
  JournalFile& operator=(const JournalFile&) = delete;

  [[nodiscard]] virtual Result<std::string> read_all() = 0;
  [[nodiscard]] virtual Result<void> append(std::string_view text) = 0;
  /// Returns when everything appended would survive a loss of power.
  [[nodiscard]] virtual Result<void> sync() = 0;
  /// Cuts a torn tail off.
  [[nodiscard]] virtual Result<void> truncate(std::uint64_t bytes) = 0;

 protected:
  JournalFile() = default;
};

/// On disk: fdatasync; created with its folder entry synced. Fails: NotPermitted, NotFound (folder), StorageFailed.
[[nodiscard]] Result<std::unique_ptr<JournalFile>> open_journal_file(const std::filesystem::path& path);

/// In memory, gone with the object. For virtual runs.
[[nodiscard]] std::unique_ptr<JournalFile> memory_journal_file();

struct JournalEntry {
  JournalStep step = JournalStep::Planned;
  LayerIndex layer;
  Nanoseconds wall{};
  Digest plan;       ///< Planned only
  std::string by;    ///< Decided* only: who decided
  LayerRecord made;  ///< Exposed, Passed and DecidedExposed only
};

/// What has been done so far, one line of JSON with a checksum each. Each line is written before the deed it announces
/// and synced where the deed cannot be taken back (Exposing, Exposed, Decided*, NotExposed, Planned, Finished,
/// Stopped). Threads: one caller at a time.
class PrintJournal {
 public:
  /// Reads what there is; drops a torn or damaged tail and cuts it off. Fails with Storage* as the file does.
  [[nodiscard]] static Result<PrintJournal> open(std::unique_ptr<JournalFile> file);

  /// No print was begun in it.
  [[nodiscard]] bool empty() const { return entries_.empty(); }
  [[nodiscard]] const std::vector<JournalEntry>& entries() const { return entries_; }
  /// Where the print goes on. {0, false} for an empty one.
  [[nodiscard]] ResumePoint resume_point() const;
  [[nodiscard]] bool finished() const;
  /// Starts of the print so far.
  [[nodiscard]] std::uint32_t runs() const;
  /// What the layers so far were made with, in order.
  [[nodiscard]] std::vector<LayerRecord> layers() const;
  /// NotTrusted when the journal belongs to another plan.
  [[nodiscard]] Result<void> belongs_to(const Digest& plan) const;
  /// Appends, and syncs where the step demands it. Fails with StorageFailed; the deed must then not be done. After a
  /// failed sync every further write fails until the journal is opened anew.
  [[nodiscard]] Result<void> write(const JournalEntry& entry);

 private:
  explicit PrintJournal(std::unique_ptr<JournalFile> file) : file_{std::move(file)} {}
  std::unique_ptr<JournalFile> file_;
  std::vector<JournalEntry> entries_;
  std::uint64_t bytes_ = 0;  ///< of whole lines
  bool broken_ = false;
};

}  // namespace telefab::fab
