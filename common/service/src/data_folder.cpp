// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstring>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/service/data_folder.hpp>
#include <utility>

namespace telefab {

Result<DataFolder> DataFolder::open(const std::filesystem::path& path) {
  std::error_code error;
  for (const auto& folder : {path, path / "incoming", path / "jobs"}) {
    std::filesystem::create_directories(folder, error);
    if (error)
      return fail(error == std::errc::permission_denied ? ErrorCode::NotPermitted : ErrorCode::StorageFailed,
                  fmt::format("cannot make the folder {}: {}", folder.string(), error.message()));
  }
  const auto lock_path = path / "lock";
  const int lock = ::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (lock < 0)
    return fail(ErrorCode::NotPermitted, fmt::format("cannot write in {}: {}", path.string(), std::strerror(errno)));
  if (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock);
    return fail(ErrorCode::Conflict,
                fmt::format("another daemon works in {}; give each its own --data", path.string()));
  }
  // Uploads that were under way when the daemon ended last.
  for (const auto& left : std::filesystem::directory_iterator{path / "incoming", error})
    std::filesystem::remove(left.path(), error);
  std::filesystem::remove(path / "port", error);
  return DataFolder{path, lock};
}

DataFolder::DataFolder(DataFolder&& other) noexcept
    : path_{std::move(other.path_)}, lock_{std::exchange(other.lock_, -1)} {}

DataFolder::~DataFolder() {
  if (lock_ >= 0) ::close(lock_);
}

Result<std::filesystem::path> DataFolder::job(std::string_view id) const {
  const auto folder = path_ / "jobs" / id;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot make the folder {}: {}", folder.string(), error.message()));
  return folder;
}

Result<void> DataFolder::announce_port(std::uint16_t port) const {
  write_output(fmt::format("{}\n", port));
  (void)flush_output();  // written again when the program ends; the file beside says the port too
  return write_file_atomically(path_ / "port", std::string_view{fmt::format("{}\n", port)});
}

void set_thread_name(const char* name) { pthread_setname_np(pthread_self(), name); }

}  // namespace telefab
