// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/print/printer_journal.hpp>

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array<std::string_view, 12> kSteps{"planned",
                                                  "uploaded",
                                                  "starting",
                                                  "not-started",
                                                  "started",
                                                  "finished",
                                                  "decided-start-again",
                                                  "decided-treat-as-started",
                                                  "pause-asked",
                                                  "resumed",
                                                  "cancel-asked",
                                                  "set-aside"};
constexpr std::array<std::string_view, 3> kEnds{"done", "stopped", "unknown"};
constexpr std::size_t kProblems = static_cast<std::size_t>(PrinterProblem::Other) + 1;

std::string body_of(const PrinterJournalEntry& e) {
  Json json{{"step", kSteps.at(static_cast<std::size_t>(e.step))}, {"wall_ns", e.wall.count()}};
  if (e.step == PrinterStep::Planned) json["plan"] = to_hex(e.plan);
  if (!e.printer.empty()) json["printer"] = e.printer;
  if (!e.printer_name.empty()) json["printer_name"] = e.printer_name;
  if (!e.file.empty()) json["file"] = e.file;
  if (!e.md5.empty()) json["md5"] = e.md5;
  if (e.step == PrinterStep::Starting || e.step == PrinterStep::Started) json["task"] = e.task;
  if (e.problem != PrinterProblem::None) json["problem"] = name_of(e.problem);
  if (e.step == PrinterStep::Finished) json["end"] = name_of(e.end);
  if (e.attempt > 0) json["attempt"] = e.attempt;
  if (!e.by.empty()) json["by"] = e.by;
  return json_text(json);
}

std::optional<PrinterJournalEntry> entry_of(std::string_view body) {
  try {
    const Json json = parsed_json(body);
    PrinterJournalEntry e;
    const auto step = std::find(kSteps.begin(), kSteps.end(), json.at("step").get<std::string>());
    if (step == kSteps.end()) return std::nullopt;
    e.step = static_cast<PrinterStep>(step - kSteps.begin());
    e.wall = Nanoseconds{whole_number<std::int64_t>(json.at("wall_ns"))};
    if (e.step == PrinterStep::Planned) {
      const auto plan = digest_from_hex(json.at("plan").get<std::string>());
      if (!plan) return std::nullopt;
      e.plan = *plan;
    }
    e.printer = json.value("printer", "");
    e.printer_name = json.value("printer_name", "");
    e.file = json.value("file", "");
    e.md5 = json.value("md5", "");
    e.task = json.value("task", "");
    if (json.contains("attempt")) e.attempt = whole_number<std::uint32_t>(json.at("attempt"));
    e.by = json.value("by", "");
    if (e.step == PrinterStep::Finished) {
      const auto end = std::find(kEnds.begin(), kEnds.end(), json.at("end").get<std::string>());
      if (end == kEnds.end()) return std::nullopt;
      e.end = static_cast<PrinterEnd>(end - kEnds.begin());
    }
    const std::string problem = json.value("problem", "none");
    std::size_t at = 0;
    while (at < kProblems && name_of(static_cast<PrinterProblem>(at)) != problem) ++at;
    if (at == kProblems) return std::nullopt;
    e.problem = static_cast<PrinterProblem>(at);
    return e;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace

std::string_view name_of(PrinterStep step) { return kSteps.at(static_cast<std::size_t>(step)); }
std::string_view name_of(PrinterEnd end) { return kEnds.at(static_cast<std::size_t>(end)); }

PrinterJournalEntry entry_of(StartDecision decision, std::string by, Nanoseconds wall) {
  PrinterJournalEntry entry;
  entry.step =
      decision == StartDecision::StartAgain ? PrinterStep::DecidedStartAgain : PrinterStep::DecidedTreatAsStarted;
  entry.by = std::move(by);
  entry.wall = wall;
  return entry;
}

Result<PrinterJournal> PrinterJournal::open(std::unique_ptr<JournalFile> file) {
  PrinterJournal journal{std::move(file)};
  const auto text = journal.file_->read_all();
  if (!text) return tl::unexpected{text.error()};
  const RecordScan scan = scan_record_lines(*text);
  const auto damaged = [] {
    return fail(ErrorCode::NotTrusted,
                "the journal of this print is damaged or of a newer version, so nobody can say whether the printer was "
                "asked to start; look at the printer, then take the journal away to begin again");
  };
  if (!scan.damage.empty()) return damaged();
  for (const RecordLine& record : scan.records) {
    auto entry = entry_of(record.body);
    if (!entry) return damaged();
    journal.entries_.push_back(std::move(*entry));
  }
  if (scan.torn_bytes > 0) {
    if (auto cut = journal.file_->truncate(scan.whole_bytes); !cut) return tl::unexpected{cut.error()};
    if (auto kept = journal.file_->sync(); !kept) return tl::unexpected{kept.error()};
  }
  return journal;
}

Result<void> PrinterJournal::begin_again(JournalFile& file, StartDecision decision, const std::string& by,
                                         Nanoseconds wall) {
  PrinterJournalEntry set_aside;
  set_aside.step = PrinterStep::SetAside;
  set_aside.by = by;
  set_aside.wall = wall;
  return file.set_aside(to_record_line(1, body_of(set_aside)) +
                        to_record_line(2, body_of(entry_of(decision, by, wall))));
}

PrinterStage PrinterJournal::stage() const {
  PrinterStage stage = PrinterStage::Nothing;
  for (const PrinterJournalEntry& e : entries_) switch (e.step) {
      case PrinterStep::Planned:
        if (stage <= PrinterStage::Uploaded) stage = PrinterStage::Planned;
        break;
      case PrinterStep::Uploaded:
      case PrinterStep::NotStarted:
      case PrinterStep::DecidedStartAgain:
        stage = PrinterStage::Uploaded;
        break;
      case PrinterStep::Starting:
        stage = PrinterStage::StartUnknown;
        break;
      case PrinterStep::Started:
      case PrinterStep::DecidedTreatAsStarted:
        stage = PrinterStage::Printing;
        break;
      case PrinterStep::Finished:
        stage = PrinterStage::Finished;
        break;
      case PrinterStep::PauseAsked:
      case PrinterStep::Resumed:
      case PrinterStep::CancelAsked:
      case PrinterStep::SetAside:
        break;
    }
  return stage;
}

const PrinterJournalEntry* PrinterJournal::last(PrinterStep step) const {
  const auto found =
      std::find_if(entries_.rbegin(), entries_.rend(), [&](const PrinterJournalEntry& e) { return e.step == step; });
  return found == entries_.rend() ? nullptr : &*found;
}

Order PrinterJournal::order() const {
  Order order = Order::None;
  for (const PrinterJournalEntry& e : entries_) {
    if (e.step == PrinterStep::PauseAsked && order != Order::Cancel) order = Order::Pause;
    if (e.step == PrinterStep::Resumed && order != Order::Cancel) order = Order::GoOn;
    if (e.step == PrinterStep::CancelAsked) order = Order::Cancel;
  }
  return order;
}

Result<void> PrinterJournal::write(PrinterJournalEntry entry) {
  if (broken_) return fail(ErrorCode::StorageFailed, "an earlier line of this journal could not be written");
  if (auto ok = file_->append(to_record_line(entries_.size() + 1, body_of(entry))); !ok) {
    broken_ = true;
    return ok;
  }
  if (auto ok = file_->sync(); !ok) {
    broken_ = true;
    return ok;
  }
  entries_.push_back(std::move(entry));
  return {};
}

}  // namespace telefab::fab
