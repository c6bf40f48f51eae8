// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/print/whole_print_record.hpp>

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kFormat = "telefab-whole-print-record-1";

Json order_of(std::string_view what, const std::string& by, Nanoseconds wall, const std::string& why) {
  Json order{{"what", what}, {"by", by}, {"wall_ns", wall.count()}};
  if (!why.empty()) order["why"] = why;
  return order;
}

}  // namespace

std::string whole_print_record(const PrinterJournal& journal, const WholePrintContext& context) {
  Json record{{"format", kFormat}, {"light", "by the printer"}};
  if (!context.job.empty()) record["job"] = context.job;
  if (!context.machine.empty()) record["machine"] = context.machine;
  Json orders = Json::array();
  for (const OrderRecord& order : context.orders)
    orders.push_back(order_of(order.word, order.by, order.wall, order.why));
  Json gaps = Json::array();
  for (const PrinterJournalEntry& e : journal.entries()) {
    switch (e.step) {
      case PrinterStep::Planned:
        record["plan"] = to_hex(e.plan);
        record["file"] = {{"name", e.file}, {"md5", e.md5}};
        break;
      case PrinterStep::Starting:
        record["printer"] = {{"id", e.printer}, {"name", e.printer_name}};
        record["asked_ns"] = e.wall.count();
        break;
      case PrinterStep::Started:
        record["task"] = e.task;
        break;
      case PrinterStep::Finished:
        record["end"] = name_of(e.end);
        record["problem"] = name_of(e.problem);
        record["ended_ns"] = e.wall.count();
        break;
      case PrinterStep::SetAside:
        gaps.push_back("it was damaged and set aside by " + e.by);
        break;
      case PrinterStep::DecidedStartAgain:
      case PrinterStep::DecidedTreatAsStarted:
      case PrinterStep::PauseAsked:
      case PrinterStep::Resumed:
      case PrinterStep::CancelAsked:
        orders.push_back(order_of(name_of(e.step), e.by, e.wall, {}));
        break;
      case PrinterStep::Uploaded:
      case PrinterStep::NotStarted:
        break;
    }
  }
  record["orders"] = std::move(orders);
  if (!gaps.empty()) record["journal_gaps"] = std::move(gaps);
  if (!context.provenance.empty()) record["provenance"] = context.provenance;
  return json_text(record, 1) + "\n";
}

bool is_whole_print_record(std::string_view text) {
  try {
    const Json json = parsed_json(text);
    return json.is_object() && json.value("format", "") == kFormat;
  } catch (const Json::exception&) {
    return false;
  }
}

Result<WholePrintRecord> whole_print_record_from_json(std::string_view text) {
  const auto wrong = [](std::string_view what) {
    return fail(ErrorCode::InvalidInput, fmt::format("the record of the print is not as expected: {}", what));
  };
  try {
    const Json json = parsed_json(text);
    if (json.at("format") != kFormat) return wrong("unknown format");
    WholePrintRecord record;
    const auto plan = digest_from_hex(json.at("plan").get<std::string>());
    if (!plan) return wrong(plan.error().what);
    record.plan = *plan;
    if (json.contains("printer")) record.printer = json.at("printer").at("name").get<std::string>();
    if (json.contains("end")) {
      const auto name = json.at("end").get<std::string>();
      for (const PrinterEnd end : {PrinterEnd::Done, PrinterEnd::Stopped, PrinterEnd::Unknown})
        if (name_of(end) == name) record.end = end;
      if (!record.end) return wrong("unknown end " + name);
    }
    if (json.contains("provenance"))
      record.provenance = json.at("provenance").get<std::map<std::string, std::string>>();
    if (json.contains("journal_gaps")) record.gaps = json.at("journal_gaps").get<std::vector<std::string>>();
    return record;
  } catch (const Json::exception& e) {
    return wrong(e.what());
  }
}

std::vector<std::string> compare(const WholePrintRecord& record, const PrintPlan& plan) {
  std::vector<std::string> findings;
  if (record.plan != plan_digest(plan)) findings.emplace_back("the record belongs to another plan");
  for (const std::string& gap : record.gaps) findings.push_back("the print's journal: " + gap);
  if (!record.end)
    findings.emplace_back("the print is not over");
  else if (*record.end != PrinterEnd::Done)
    findings.push_back(fmt::format("the print ended {}", name_of(*record.end)));
  return findings;
}

}  // namespace telefab::fab
