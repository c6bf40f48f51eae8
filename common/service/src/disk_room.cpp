// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <telefab/base/file.hpp>
#include <telefab/service/disk_room.hpp>
#include <utility>

namespace telefab {
namespace {

constexpr const char* kReserveFile = "reserve";

Result<std::filesystem::space_info> space_of(const std::filesystem::path& folder) {
  std::error_code error;
  const auto space = std::filesystem::space(folder, error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot ask for the free room of {}: {}", folder.string(), error.message()));
  return space;
}

/// Rounded up: what is needed is never said smaller than it is.
std::uint64_t mib(std::uint64_t bytes) { return (bytes + (1U << 20U) - 1) >> 20U; }

}  // namespace

DiskRoom::DiskRoom(std::filesystem::path folder, std::uint64_t reserve_bytes, AskSpace ask)
    : folder_{std::move(folder)}, reserve_bytes_{reserve_bytes}, ask_{ask ? std::move(ask) : space_of} {
  // A reserve of another size may lie there from the last start.
  std::error_code error;
  if (std::filesystem::file_size(folder_ / kReserveFile, error) != reserve_bytes_ || error)
    std::filesystem::remove(folder_ / kReserveFile, error);
  if (auto taken = take_reserve(); !taken) trouble_ = taken.error();
}

Result<void> DiskRoom::take_reserve() {
  if (is_held_ || reserve_bytes_ == 0) return {};
  const auto path = folder_ / kReserveFile;
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  int error = file < 0 ? errno : 0;
  if (file >= 0) {
    if (::fallocate(file, 0, 0, static_cast<off_t>(reserve_bytes_)) != 0) error = errno;
    ::close(file);
  }
  // A file system that cannot keep room for a file keeps none; then check() leaves as much free.
  if (error == 0 || error == EOPNOTSUPP || error == ENOSYS) {
    is_held_ = error == 0;
    return {};
  }
  std::error_code ignored;  // half a reserve is none
  std::filesystem::remove(path, ignored);
  // Jobs wait for the disk whatever the reason is.
  return fail(ErrorCode::StorageFailed, fmt::format("the reserve of {} MiB cannot be taken: {}", mib(reserve_bytes_),
                                                    fail_system("keep room in", folder_, error).value().what));
}

Result<void> DiskRoom::check(std::uint64_t bytes) {
  const std::lock_guard lock{mutex_};
  const auto checked = [&]() -> Result<void> {
    const auto space = ask_(folder_);
    if (!space) return tl::unexpected{space.error()};
    const std::uint64_t coming = bytes > 0 ? expected_bytes() : 0;
    const std::uint64_t wanted = bytes + coming + (is_held_ ? 0 : reserve_bytes_);
    if (space->capacity < bytes + reserve_bytes_)
      return fail(ErrorCode::TooLarge,
                  fmt::format("the disk of {} MiB is too small: {} MiB are needed beside a reserve of {}",
                              space->capacity >> 20U, mib(bytes), mib(reserve_bytes_)));
    if (space->available < wanted)
      return fail(ErrorCode::StorageFailed,
                  fmt::format("{} MiB of disk are free, {} are needed{}{}", space->available >> 20U, mib(bytes),
                              coming > 0 ? fmt::format(" beside {} that are on their way", mib(coming)) : "",
                              is_held_ ? "" : fmt::format(" beside a reserve of {}", mib(reserve_bytes_))));
    return take_reserve();
  }();
  trouble_ = checked ? std::nullopt : std::optional{checked.error()};
  return checked;
}

void DiskRoom::expect(const std::string& what, std::uint64_t bytes) {
  const std::lock_guard lock{mutex_};
  if (bytes > 0)
    expected_.insert_or_assign(what, bytes);
  else
    expected_.erase(what);
}

std::uint64_t DiskRoom::expected_bytes() const {
  std::uint64_t sum = 0;
  for (const auto& [what, bytes] : expected_) sum += bytes;
  return sum;
}

Result<std::uint64_t> DiskRoom::room() const {
  const std::lock_guard lock{mutex_};
  const auto space = ask_(folder_);
  if (!space) return tl::unexpected{space.error()};
  const std::uint64_t kept = expected_bytes() + (is_held_ ? 0 : reserve_bytes_);
  return space->available > kept ? space->available - kept : 0;
}

bool DiskRoom::give_up_reserve() {
  const std::lock_guard lock{mutex_};
  if (!std::exchange(is_held_, false)) return false;
  std::error_code error;
  const bool is_free = std::filesystem::remove(folder_ / kReserveFile, error);
  trouble_ = Error{ErrorCode::StorageFailed,
                   fmt::format("the disk is full; the reserve of {} MiB was given up", mib(reserve_bytes_))};
  return is_free;
}

void DiskRoom::note_trouble(const Error& error) {
  const std::lock_guard lock{mutex_};
  trouble_ = error;
}

void DiskRoom::wait(const std::string& job, const Error& why) {
  const std::lock_guard lock{mutex_};
  waiting_.insert_or_assign(job, why);
}

void DiskRoom::go_on(const std::string& job) {
  const std::lock_guard lock{mutex_};
  waiting_.erase(job);
}

Result<void> DiskRoom::health() const {
  const std::lock_guard lock{mutex_};
  if (trouble_) return tl::unexpected{*trouble_};
  if (waiting_.empty()) return {};
  const auto& [job, why] = *waiting_.begin();
  const std::string others = waiting_.size() > 1 ? fmt::format("; {} more wait", waiting_.size() - 1) : "";
  return fail(why.code, fmt::format("job {} waits: {}{}", job, why.what, others));
}

}  // namespace telefab
