// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <telefab/base/clock.hpp>
#include <telefab/base/digest.hpp>

namespace telefab {

/// Who did what, or was refused what: one line of JSON an entry, append-only, each with the SHA-256 of the entry before
/// it, so that a changed, dropped or inserted line shows, and a checksum for the last one. Fsynced; nothing is ever
/// written behind a write that failed. Threads: any.
class AuditLog {
 public:
  /// Checks the whole file first; cuts off a torn last line. Fails with NotTrusted, naming the line, where the chain is
  /// broken; NotPermitted, StorageFailed.
  [[nodiscard]] static Result<std::unique_ptr<AuditLog>> open(const std::filesystem::path& path, const Clock& clock);
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

/// The last whole line of an audit log. Each line holds the hash of the one before, so this one stands for all.
struct AuditHead {
  std::uint64_t entries = 0;
  Digest line;  ///< SHA-256 of it, without its end
};
/// Reads the end of the file alone; the chain is not followed. NotFound where there is none, NotTrusted where its last
/// line is no entry.
[[nodiscard]] Result<AuditHead> audit_head(const std::filesystem::path& path);

}  // namespace telefab
