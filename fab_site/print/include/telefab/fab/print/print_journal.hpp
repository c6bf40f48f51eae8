// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <telefab/base/record_line.hpp>
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
  /// Keeps the bytes as they are under a name of their own and goes on with `text`, synced.
  [[nodiscard]] virtual Result<void> set_aside(std::string_view text) = 0;
  /// Room for so many bytes more, so that a full disk ends no print that began and loses no operator's word.
  [[nodiscard]] virtual Result<void> reserve(std::uint64_t bytes) = 0;

 protected:
  JournalFile() = default;
};

/// On disk: fdatasync; created with its folder entry synced. A damaged one is set aside as PATH.damaged-N. Fails:
/// NotPermitted, NotFound (folder), StorageFailed.
[[nodiscard]] Result<std::unique_ptr<JournalFile>> open_journal_file(const std::filesystem::path& path);

/// In memory, gone with the object. For virtual runs.
[[nodiscard]] std::unique_ptr<JournalFile> memory_journal_file();
/// The same on bytes of somebody else's, which outlive it: to see what is written.
[[nodiscard]] std::unique_ptr<JournalFile> memory_journal_file(std::string& bytes);

struct JournalEntry {
  JournalStep step = JournalStep::Planned;
  LayerIndex layer;
  Nanoseconds wall{};
  Digest plan;       ///< Planned only
  std::string by;    ///< Decided* and operators' words: whose
  LayerRecord made;  ///< Exposed, Passed and DecidedTreatAsExposed only
  std::string why;   ///< Approved: what an operator said about what holds the job; Faulted, SetAside: the cause
  std::uint32_t attempt = 0;  ///< Planned, Exposing: of the fleet's job; 0: it is no job of a fleet
};

/// What a print is allowed to do by the last word about it.
enum class Order : std::uint8_t {
  None,    ///< nobody has said anything yet
  GoOn,    ///< approved, resumed, or a layer in question decided by an operator
  Pause,   ///< no further exposure until resumed
  Cancel,  ///< never another exposure
};
struct StandingOrder {
  Order order = Order::None;
  std::string by;
  Nanoseconds wall{};
};

/// What has been done so far and who allowed it, a record line (record_line.hpp) of JSON each. Each line is written
/// before the operation it announces and synced where the operation cannot be taken back (all but Ready and Lifted).
/// Exposing is refused while the standing order is Pause or Cancel: no light without a living order, whoever asks. So
/// is every start and exposure of an older attempt than the journal knows. Threads: one caller at a time.
class PrintJournal {
 public:
  /// Reads what there is and cuts a torn tail off. Damage is left as it is (damage()), and nothing is written behind it
  /// before set_aside(). Lines "CHECKSUM JSON" without length and number, as version 0.1 wrote them, are read
  /// where they stand before the first record line. Fails with Storage* as the file does.
  [[nodiscard]] static Result<PrintJournal> open(std::unique_ptr<JournalFile> file);

  /// No print was begun in it.
  [[nodiscard]] bool empty() const { return runs() == 0; }
  [[nodiscard]] const std::vector<JournalEntry>& entries() const { return entries_; }
  [[nodiscard]] const std::vector<RecordDamage>& damage() const { return damage_; }
  [[nodiscard]] StandingOrder order() const;
  /// Where the print goes on. {0, false} for an empty one. In question too where the end of the journal is damaged.
  [[nodiscard]] ResumePoint resume_point() const;
  [[nodiscard]] bool finished() const;
  /// The newest attempt that a line is of; 0: it is no job of a fleet.
  [[nodiscard]] std::uint32_t attempt() const;
  /// Starts of the print so far.
  [[nodiscard]] std::uint32_t runs() const;
  /// What the layers so far were made with, in the order of the journal; one that was made twice is there twice.
  [[nodiscard]] std::vector<LayerRecord> layers() const;
  /// Words of operators, in order.
  [[nodiscard]] std::vector<OrderRecord> orders() const;
  /// Where the journal does not cover the print: records lost, a layer announced again without a decision. Empty: it
  /// does. A line a finding, for people.
  [[nodiscard]] std::vector<std::string> gaps() const;
  /// NotTrusted when the journal belongs to another plan.
  [[nodiscard]] Result<void> belongs_to(const Digest& plan) const;
  /// Appends, and syncs where the step demands it. Fails with StorageFailed, NotTrusted (damaged and not set aside),
  /// Conflict (Exposing against the standing order, or of an older attempt); the operation must then not be done. After
  /// a failed sync every further write fails until the journal is opened again.
  [[nodiscard]] Result<void> write(const JournalEntry& entry);
  /// The damaged file is kept beside; what was sound goes on here, a SetAside line says by whom and what is lost, and
  /// `words`, the operator's decision, follow it: all of it or nothing.
  [[nodiscard]] Result<void> set_aside(std::string by, Nanoseconds wall, std::vector<JournalEntry> words);
  /// Room for what is still to be written of `layers` layers, and for words of operators. StorageFailed: there is none.
  [[nodiscard]] Result<void> reserve(LayerIndex layers);
  /// Bytes that reserve() takes.
  [[nodiscard]] static std::uint64_t room_bytes(LayerIndex layers);

 private:
  explicit PrintJournal(std::unique_ptr<JournalFile> file) : file_{std::move(file)} {}
  std::unique_ptr<JournalFile> file_;
  std::vector<JournalEntry> entries_;
  std::vector<RecordDamage> damage_;
  std::uint64_t bytes_ = 0;  ///< of whole lines
  bool broken_ = false;
};

}  // namespace telefab::fab
