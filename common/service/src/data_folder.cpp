// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <span>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/service/data_folder.hpp>
#include <utility>

namespace telefab {
namespace {

constexpr std::uint64_t kMaxRecordBytes = 1U << 30U;
/// A daemon that was killed can leave a child behind that was just begun: for some milliseconds, more on a busy
/// machine, it is a copy of the daemon and holds the lock too.
constexpr auto kChildrenEndWithin = std::chrono::seconds{3};

}  // namespace

Result<DataFolder> DataFolder::open(const std::filesystem::path& path) {
  std::error_code error;
  for (const auto& folder : {path, path / "incoming", path / "jobs"}) {
    std::filesystem::create_directories(folder, error);
    if (error == std::errc::not_a_directory || error == std::errc::file_exists)
      return fail(ErrorCode::InvalidInput, fmt::format("{} is a file; name a folder", folder.string()));
    if (error) return fail_system("make the folder", folder, error.value());
  }
  const auto lock_path = path / "lock";
  OpenFile lock{::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640)};
  if (lock.get() < 0) return fail_system("write in", path, errno);
  if (const int held = take_lock(lock, kChildrenEndWithin); held != 0) {
    if (held != EWOULDBLOCK) return fail_system("lock", lock_path, held);
    return fail(ErrorCode::Conflict,
                fmt::format("another daemon works in {}; give each its own --data", path.string()));
  }
  // Uploads that were under way when the daemon ended last, and jobs that were being forgotten.
  for (const auto& left : std::filesystem::directory_iterator{path / "incoming", error})
    std::filesystem::remove_all(left.path(), error);
  std::filesystem::remove(path / "port", error);
  return DataFolder{path, std::move(lock)};
}

Result<void> make_folder(const std::filesystem::path& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (!error) return {};
  return fail(ErrorCode::StorageFailed, fmt::format("cannot make the folder {}: {}", path.string(), error.message()));
}

Result<std::filesystem::path> DataFolder::job(std::string_view id) const {
  const auto folder = path_ / "jobs" / id;
  if (auto made = make_folder(folder); !made) return tl::unexpected{made.error()};
  return folder;
}

Result<std::optional<std::filesystem::path>> DataFolder::take_out(std::string_view id) const {
  const auto folder = path_ / "jobs" / id;
  std::error_code error;
  if (!std::filesystem::exists(folder, error)) return std::optional<std::filesystem::path>{};
  if (const auto record = folder / "report" / "as-built.json"; std::filesystem::exists(record, error)) {
    const auto bytes = read_file(record, kMaxRecordBytes);
    if (!bytes) return tl::unexpected{bytes.error()};
    if (auto made = make_folder(path_ / "records"); !made) return tl::unexpected{made.error()};
    const auto kept = path_ / "records" / fmt::format("{}.json", id);
    if (auto written = write_file_atomically(kept, std::span<const std::byte>{*bytes}); !written)
      return tl::unexpected{written.error()};
  }
  const auto taken = incoming() / fmt::format("forgotten-{}", id);
  std::filesystem::rename(folder, taken, error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot take the folder of job {} out of jobs: {}", id, error.message()));
  return std::optional{taken};
}

Result<void> DataFolder::put_back(std::string_view id, const std::filesystem::path& taken) const {
  std::error_code error;
  std::filesystem::rename(taken, path_ / "jobs" / id, error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot put the folder {} of job {} back: {}", taken.string(), id, error.message()));
  return {};
}

Result<void> DataFolder::announce_port(std::uint16_t port) const {
  write_output(fmt::format("{}\n", port));
  (void)flush_output();  // written again when the program ends; the file beside says the port too
  return write_file_atomically(path_ / "port", std::string_view{fmt::format("{}\n", port)});
}

std::uint64_t bytes_in(const std::filesystem::path& folder) {
  std::uint64_t bytes = 0;
  std::error_code error;
  for (const auto& file : std::filesystem::recursive_directory_iterator{folder, error})
    if (file.is_regular_file(error))
      if (const auto size = file.file_size(error); !error) bytes += size;
  return bytes;
}

void set_thread_name(const char* name) { pthread_setname_np(pthread_self(), name); }

void give_way() {
  constexpr int kLowPriority = 10;
  (void)::setpriority(PRIO_PROCESS, 0, kLowPriority);  // of a thread, here; without it all goes on as well
}

}  // namespace telefab
