// SPDX-License-Identifier: GPL-3.0-or-later
#include "print_records.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/signature.hpp>
#include <telefab/base/version.hpp>
#include <telefab/fab/print/provenance.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/store/audit_log.hpp>
#include <telefab/transfer/chunk_spool.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kLargestPlanFile = 1U << 30U;

/// The key that as-built records are signed with, as-built-key.pem beside the jobs; made with its public half,
/// as-built-key.pub, for the first record.
Result<std::string> as_built_key(const std::filesystem::path& site) {
  return kept_ed25519_key(site / "as-built-key.pem", site / "as-built-key.pub");
}

std::filesystem::path site_of(const std::filesystem::path& folder) { return folder.parent_path().parent_path(); }

void add_audit_head(const std::filesystem::path& folder, std::map<std::string, std::string>& known) {
  if (const auto head = audit_head(site_of(folder) / "audit.log")) {
    known[provenance::kAuditEntries] = std::to_string(head->entries);
    known[provenance::kAuditHead] = to_hex(head->line);
  } else if (head.error().code != ErrorCode::NotFound) {
    known[provenance::kAuditHead] = "unreadable";  // a print that is over has its record all the same
  }
}

Result<void> keep_as_built(const std::filesystem::path& folder, const Result<std::string>& sealed) {
  if (!sealed) return tl::unexpected{sealed.error()};
  return write_file_atomically(folder / "report" / "as-built.json", *sealed);
}

Result<void> keep_print(const std::filesystem::path& folder, const std::string& record) {
  if (auto made = make_folder(folder / "report"); !made) return made;
  return write_file_atomically(folder / "report" / "print.json", record + "\n");
}

}  // namespace

std::map<std::string, std::string> provenance_of(const std::filesystem::path& folder, const std::string& instance) {
  std::map<std::string, std::string> known{{provenance::kSoftware, fmt::format("telefab-fab {}", kVersion)},
                                           {provenance::kInstance, instance}};
  if (const auto offer = saved_offer(folder)) {
    known[provenance::kScanName] = offer->header.scan_name;
    if (offer->scan != Digest{}) known[provenance::kScan] = to_hex(offer->scan);
    if (offer->registration_rms_mm > 0)
      known[provenance::kRegistration] = fmt::format("{:.6g}", offer->registration_rms_mm);
    known[provenance::kProfile] = to_hex(offer->profile);
    known[provenance::kParameters] = offer->parameters;
    known[provenance::kTransform] = fmt::format("{}", fmt::join(offer->header.scan_to_build, " "));
    std::string key;
    for (const std::byte b : offer->public_key) key += fmt::format("{:02x}", std::to_integer<unsigned>(b));
    if (!key.empty()) known[provenance::kSignedBy] = key;
  }
  if (const auto spool = ChunkSpool::open(folder / "chunks"); spool && spool->finished())
    known[provenance::kContours] = to_hex(*spool->finished());
  if (const auto supports = read_file(folder / "plan" / "supports.json", kLargestPlanFile))
    known[provenance::kSupports] = to_hex(digest_of(*supports));
  if (const auto part = read_file(folder / "plan" / "part.tfc", kLargestPlanFile))
    known[provenance::kPart] = to_hex(digest_of(*part));
  return known;
}

Result<void> keep_records(const std::filesystem::path& folder, const PrintRecord& record) {
  if (auto kept = keep_print(folder, to_json(record)); !kept) return kept;
  const auto key = as_built_key(site_of(folder));
  if (!key) return tl::unexpected{key.error()};
  PrintRecord sealed = record;
  add_audit_head(folder, sealed.provenance);
  return keep_as_built(folder, seal(sealed, *key));
}

Result<void> keep_records(const std::filesystem::path& folder, const PrinterJournal& journal,
                          WholePrintContext context) {
  if (auto kept = keep_print(folder, whole_print_record(journal, context)); !kept) return kept;
  const auto key = as_built_key(site_of(folder));
  if (!key) return tl::unexpected{key.error()};
  add_audit_head(folder, context.provenance);
  return keep_as_built(folder, seal_json(whole_print_record(journal, context), *key));
}

}  // namespace telefab::fab
