// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <string>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/fab/print/printer_journal.hpp>
#include <vector>

namespace telefab::fab {

/// What is known of such a print beside its journal; all of it may be empty.
struct WholePrintContext {
  std::string job;
  std::string machine;                            ///< profile of the plan
  std::map<std::string, std::string> provenance;  ///< keys of provenance.hpp
  std::vector<OrderRecord> orders;                ///< operators' words that are kept elsewhere, in order
};

/// What is known of a print on a printer that owns its light, as canonical JSON: plan, file, printer, task, times, end,
/// operators' words, and "light": "by the printer", for nothing here timed or saw it. Same journal, same bytes.
[[nodiscard]] std::string whole_print_record(const PrinterJournal& journal, const WholePrintContext& context = {});

/// What such a record says, as far as it can be held against a plan.
struct WholePrintRecord {
  Digest plan;
  std::string printer;            ///< model and firmware; empty: none was asked
  std::optional<PrinterEnd> end;  ///< none: it is not over
  std::map<std::string, std::string> provenance;
  std::vector<std::string> gaps;  ///< where the print's journal does not cover it
};
/// Whether the text is a record of this kind; what it says need not hold.
[[nodiscard]] bool is_whole_print_record(std::string_view text);
/// Fails with InvalidInput.
[[nodiscard]] Result<WholePrintRecord> whole_print_record_from_json(std::string_view text);
/// What is wrong with the record against the plan that it claims, a line a finding. Empty: the printer says that it
/// made it, which is all that anybody knows.
[[nodiscard]] std::vector<std::string> compare(const WholePrintRecord& record, const PrintPlan& plan);

}  // namespace telefab::fab
