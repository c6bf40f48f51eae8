// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <telefab/base/clock.hpp>
#include <telefab/base/digest.hpp>
#include <vector>

namespace telefab {

inline constexpr std::uint64_t kAuditPartBytes = 256U << 10U;

/// Who did what, or was refused what: one line of JSON an entry, append-only, each with the SHA-256 of the entry before
/// it, so that a changed, dropped or inserted line shows, and a checksum for the last one. Fsynced; nothing is ever
/// written behind a write that failed. A log that has grown becomes a closed part, PATH.000001 and so on, and goes on
/// in a new file, whose first line holds the digest of the last line of the part. Threads: any.
class AuditLog {
 public:
  /// Checks the last part, and that it goes on where the one before ends; cuts off a torn last line. However long the
  /// log is, that takes as long as for one part. Fails with NotTrusted, naming the line, where the chain is broken or a
  /// part is missing; NotPermitted, StorageFailed. `part_bytes`: a part that has so many takes no more lines.
  [[nodiscard]] static Result<std::unique_ptr<AuditLog>> open(const std::filesystem::path& path, const Clock& clock,
                                                              std::uint64_t part_bytes = kAuditPartBytes);
  ~AuditLog();
  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;
  /// Durable when it returns. Both texts are cut at 1,000 bytes.
  [[nodiscard]] Result<void> add(std::string_view who, std::string_view what);

 private:
  struct Impl;
  explicit AuditLog(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The files of a log, oldest first: its closed parts and, where it is there, the one that takes lines.
[[nodiscard]] std::vector<std::filesystem::path> audit_parts(const std::filesystem::path& path);

/// The last whole line of an audit log. Each line holds the hash of the one before, so this one stands for all.
struct AuditHead {
  std::uint64_t entries = 0;
  Digest line;  ///< SHA-256 of it, without its end
};
/// Reads the end of the last part alone; the chain is not followed. NotFound where there is no log, NotTrusted where
/// its last line is no entry.
[[nodiscard]] Result<AuditHead> audit_head(const std::filesystem::path& path);
/// Follows the chain through every part; of the last one a torn end is passed over. Fails as open() and audit_head().
[[nodiscard]] Result<AuditHead> check_audit_log(const std::filesystem::path& path);

}  // namespace telefab
