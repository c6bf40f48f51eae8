// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/fab/print/whole_print_record.hpp>

// Both records of a print, in the report of its job's folder: print.json, and as-built.json, which is sealed and signed
// with the fab's key and has the head of its audit log in it.
namespace telefab::fab {

/// Where the part comes from: what the scan site said and signed, what was received, what was planned; and which
/// machine made it.
[[nodiscard]] std::map<std::string, std::string> provenance_of(const std::filesystem::path& folder,
                                                               const std::string& instance);

/// Of a print that has ended, or faulted. Fails: StorageFailed, NotPermitted.
[[nodiscard]] Result<void> keep_records(const std::filesystem::path& folder, const PrintRecord& record);
/// Of a print on a whole printer.
[[nodiscard]] Result<void> keep_records(const std::filesystem::path& folder, const PrinterJournal& journal,
                                        WholePrintContext context);

}  // namespace telefab::fab
