// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string_view>
#include <telefab/base/open_file.hpp>
#include <telefab/base/result.hpp>

namespace telefab {

/// A daemon's folder: jobs.sqlite, audit.log, port, incoming/, jobs/ID/ and records/. Locked while the daemon lives, so
/// that two daemons never share one.
class DataFolder {
 public:
  /// Makes what is missing. Fails with NotPermitted, StorageFailed, Conflict (another daemon works there, for seconds).
  [[nodiscard]] static Result<DataFolder> open(const std::filesystem::path& path);

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] std::filesystem::path incoming() const { return path_ / "incoming"; }
  /// The folder of a job, which exists afterwards.
  [[nodiscard]] Result<std::filesystem::path> job(std::string_view id) const;
  /// Takes the folder of a job out of jobs/ in one step; where it lies until it is removed, at the latest by the next
  /// open(). The as-built record of the job is kept as records/ID.json. Nothing where there is no folder.
  [[nodiscard]] Result<std::optional<std::filesystem::path>> take_out(std::string_view id) const;
  /// Puts it back where it was.
  [[nodiscard]] Result<void> put_back(std::string_view id, const std::filesystem::path& taken) const;
  /// Tells which port was bound: one line on standard output and the file `port`.
  [[nodiscard]] Result<void> announce_port(std::uint16_t port) const;

 private:
  DataFolder(std::filesystem::path path, OpenFile lock) : path_{std::move(path)}, lock_{std::move(lock)} {}
  std::filesystem::path path_;
  OpenFile lock_;
};

/// Makes a folder in a daemon's own one, and those above it, where there is none. Fails with StorageFailed, whatever
/// the reason: a job waits for its disk, and does not end.
[[nodiscard]] Result<void> make_folder(const std::filesystem::path& path);

/// What the files in a folder and below take; what cannot be read counts as nothing.
[[nodiscard]] std::uint64_t bytes_in(const std::filesystem::path& folder);

/// Names the calling thread, as the site's README lists it; at most 15 bytes.
void set_thread_name(const char* name);

/// The calling thread, and those that it begins from now on, give way to all others where cores are few.
void give_way();

}  // namespace telefab
