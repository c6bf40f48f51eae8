// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <telefab/base/file.hpp>
#include <utility>

namespace telefab {
namespace {

constexpr mode_t kAnyMode = 0666;  ///< less what the umask takes
constexpr int kMostTries = 16;

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_{fd} {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return fd_; }
  /// Closes now, so that a failure to write back is seen.
  [[nodiscard]] bool close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

/// 0, or the errno that stopped it.
int write_all(int fd, std::span<const std::byte> bytes) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t put = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return errno;
    done += static_cast<std::size_t>(put);
  }
  return 0;
}

}  // namespace

tl::unexpected<Error> fail_system(std::string_view action, const std::filesystem::path& path, int error) {
  switch (error) {
    case ENOENT:
    case ENOTDIR:
      return fail(ErrorCode::NotFound,
                  fmt::format("cannot {} {}: no such file or folder; check the path", action, path.string()));
    case EACCES:
    case EPERM:
      return fail(
          ErrorCode::NotPermitted,
          fmt::format("cannot {} {}: permission denied; change its mode or run as its owner", action, path.string()));
    case ENOSPC:
    case EDQUOT:
      return fail(ErrorCode::StorageFailed,
                  fmt::format("cannot {} {}: the disk is full; make room and try again", action, path.string()));
    case EROFS:
      // Nobody's permission: a file system that met errors turns read-only, and jobs wait for it as for a full one.
      return fail(
          ErrorCode::StorageFailed,
          fmt::format("cannot {} {}: its file system is read-only; see in the system's log why, and mount it for "
                      "writing",
                      action, path.string()));
    default:
      return fail(ErrorCode::StorageFailed,
                  fmt::format("cannot {} {}: {}", action, path.string(), std::strerror(error)));
  }
}

Result<std::vector<std::byte>> read_file(const std::filesystem::path& path, std::uint64_t limit_bytes) {
  Descriptor file{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
  if (file.get() < 0) return fail_system("read", path, errno);
  struct stat status {};
  if (::fstat(file.get(), &status) != 0) return fail_system("read", path, errno);
  if (S_ISDIR(status.st_mode))
    return fail(ErrorCode::InvalidInput,
                fmt::format("cannot read {}: it is a folder; name a file in it", path.string()));
  if (!S_ISREG(status.st_mode))
    return fail(ErrorCode::InvalidInput, fmt::format("cannot read {}: it is not a regular file", path.string()));
  const auto size = static_cast<std::uint64_t>(status.st_size);
  if (size > limit_bytes)
    return fail(ErrorCode::TooLarge, fmt::format("{} has {} bytes; the limit is {}", path.string(), size, limit_bytes));
  std::vector<std::byte> bytes(size);
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::read(file.get(), bytes.data() + done, bytes.size() - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return fail_system("read", path, errno);
    if (got == 0)
      return fail(ErrorCode::StorageFailed,
                  fmt::format("{} became shorter while it was read; try again", path.string()));
    done += static_cast<std::size_t>(got);
  }
  return bytes;
}

Result<std::filesystem::path> make_temporary_beside(const std::filesystem::path& path) {
  // A rename would put a plain file in the place of a folder or device.
  struct stat status {};
  if (::stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode))
    return fail(ErrorCode::InvalidInput,
                fmt::format("cannot write {}: it is not a regular file; name another", path.string()));
  for (int tries = 0; tries < kMostTries; ++tries) {
    std::uint64_t random = 0;
    if (::getrandom(&random, sizeof random, 0) != sizeof random) return fail_system("write", path, errno);
    // Hidden, so that nobody who lists the folder takes it for a file that is there to stay. Its mode is what the umask
    // leaves, as of any file that a program writes.
    const auto temporary = path.parent_path() / fmt::format(".{}.{:016x}", path.filename().string(), random);
    const Descriptor file{::open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, kAnyMode)};
    if (file.get() >= 0) return temporary;
    if (errno != EEXIST) return fail_system("write", path, errno);
  }
  return fail_system("write", path, EEXIST);
}

Result<void> put_in_place(const std::filesystem::path& temporary, const std::filesystem::path& path) {
  const auto give_up = [&](int error) {
    ::unlink(temporary.c_str());
    return fail_system("write", path, error);
  };
  Descriptor file{::open(temporary.c_str(), O_RDWR | O_CLOEXEC)};
  if (file.get() < 0) return give_up(errno);
  if (::fsync(file.get()) != 0) return give_up(errno);
  if (!file.close()) return give_up(errno);
  if (::rename(temporary.c_str(), path.c_str()) != 0) return give_up(errno);
  return sync_folder_of(path);
}

Result<void> write_new_secret(const std::filesystem::path& path, std::string_view text) {
  const auto give_up = [&](int error) {
    return fail(ErrorCode::StorageFailed, fail_system("write", path, error).value().what);
  };
  // Under its name it is whole or not there: a secret that a full disk cut short would be taken for one.
  std::string temporary = (path.parent_path() / ("." + path.filename().string() + ".XXXXXX")).string();
  Descriptor file{::mkostemp(temporary.data(), O_CLOEXEC)};  // 0600
  if (file.get() < 0) return give_up(errno);
  int error = write_all(file.get(), std::as_bytes(std::span{text}));
  if (error == 0 && ::fsync(file.get()) != 0) error = errno;
  if (error == 0 && ::link(temporary.c_str(), path.c_str()) != 0) error = errno;
  ::unlink(temporary.c_str());
  if (error != 0) return give_up(error);
  return sync_folder_of(path);
}

Result<void> write_file_atomically(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  const auto temporary = make_temporary_beside(path);
  if (!temporary) return tl::unexpected{temporary.error()};
  Descriptor file{::open(temporary->c_str(), O_WRONLY | O_CLOEXEC)};
  int error = file.get() < 0 ? errno : write_all(file.get(), bytes);
  if (error == 0 && !file.close()) error = errno;
  if (error != 0) {
    ::unlink(temporary->c_str());
    return fail_system("write", path, error);
  }
  return put_in_place(*temporary, path);
}

Result<void> write_file_atomically(const std::filesystem::path& path, std::string_view text) {
  return write_file_atomically(path, std::as_bytes(std::span{text}));
}

Result<void> write_new_file(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  Descriptor file{::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kAnyMode)};
  if (file.get() < 0) return fail_system("write", path, errno);
  if (const int error = write_all(file.get(), bytes)) return fail_system("write", path, error);
  if (!file.close()) return fail_system("write", path, errno);
  return {};
}

Result<void> sync_folder_of(const std::filesystem::path& file) {
  const Descriptor folder{
      ::open(file.has_parent_path() ? file.parent_path().c_str() : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (folder.get() < 0 || ::fsync(folder.get()) != 0) return fail_system("sync the folder of", file, errno);
  return {};
}

Result<void> sync_file_system(const std::filesystem::path& path) {
  Descriptor file{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
  if (file.get() < 0 || ::syncfs(file.get()) != 0) return fail_system("sync", path, errno);
  return {};
}

}  // namespace telefab
