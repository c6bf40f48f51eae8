// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_store_backups.hpp"

#include <fmt/format.h>

#include <telefab/base/damaged_file.hpp>
#include <telefab/base/file.hpp>
#include <telefab/store/job_store.hpp>

namespace telefab {

std::filesystem::path backup_of(const std::filesystem::path& store, int number) {
  return fmt::format("{}.backup-{}", store.string(), number);
}

namespace {

/// Gives the damaged file and what belongs to it other names; the first of them.
Result<std::filesystem::path> set_aside(const std::filesystem::path& path) {
  auto aside = name_for_damaged(path);
  if (!aside) return aside;
  std::error_code error;
  for (const char* part : {"-wal", "-shm"})
    if (!error && std::filesystem::exists(path.string() + part, error))
      std::filesystem::rename(path.string() + part, aside->string() + part, error);
  if (!error) std::filesystem::rename(path, *aside, error);
  if (!error) return aside;
  return fail(ErrorCode::StorageFailed,
              fmt::format("{} is damaged and cannot be set aside: {}", path.string(), error.message()));
}

}  // namespace

Result<RestoredStore> open_or_restore(const std::filesystem::path& path, const Clock& clock) {
  std::error_code error;
  const auto backup = [&](int number) { return backup_of(path, number); };
  std::string notice;
  // A start that ended while it restored leaves no file, and backups.
  if (!std::filesystem::exists(path, error) && std::filesystem::exists(backup(1), error)) {
    notice = fmt::format("job store {} is missing", path.string());
  } else {
    auto store = JobStore::open(path, clock);
    if (store) return RestoredStore{std::move(*store), {}};
    if (store.error().code != ErrorCode::NotTrusted) return tl::unexpected{store.error()};
    const auto aside = set_aside(path);
    if (!aside) return tl::unexpected{aside.error()};
    notice = fmt::format("{}; it is kept as {}", store.error().what, aside->string());
  }
  for (int number = 1; number <= kStoreBackups; ++number) {
    if (!std::filesystem::exists(backup(number), error)) continue;
    const auto copy = make_temporary_beside(path);
    if (!copy) return tl::unexpected{copy.error()};
    std::filesystem::copy_file(backup(number), *copy, std::filesystem::copy_options::overwrite_existing, error);
    if (error)
      return fail(ErrorCode::StorageFailed,
                  fmt::format("cannot copy {}: {}", backup(number).string(), error.message()));
    if (auto placed = put_in_place(*copy, path); !placed) return tl::unexpected{placed.error()};
    auto store = JobStore::open(path, clock);
    if (store)
      return RestoredStore{std::move(*store), fmt::format("{}; {} took its place, and changes since then are lost",
                                                          notice, backup(number).string())};
    if (store.error().code != ErrorCode::NotTrusted) return tl::unexpected{store.error()};
    for (const char* part : {"", "-wal", "-shm"}) std::filesystem::remove(path.string() + part, error);
  }
  auto store = JobStore::open(path, clock);
  if (!store) return tl::unexpected{store.error()};
  return RestoredStore{std::move(*store), notice + "; there is no sound backup, and the list begins empty"};
}

}  // namespace telefab
