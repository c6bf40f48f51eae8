// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>

namespace telefab {
namespace {

constexpr std::uint64_t kLargestSecret = 64U << 10U;
constexpr mode_t kGroup = S_IRGRP | S_IWGRP;
constexpr mode_t kOthers = S_IROTH | S_IWOTH;

}  // namespace

Result<void> check_is_secret(const std::filesystem::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return fail_system("look at", path, errno);
  // A service account reads a key that belongs to root by its group.
  const bool is_of_our_group = status.st_gid == ::getegid() && (status.st_mode & S_IWGRP) == 0;
  if ((status.st_mode & kOthers) != 0 || ((status.st_mode & kGroup) != 0 && !is_of_our_group))
    return fail(ErrorCode::NotTrusted, fmt::format("the secret {0} can be read or changed by others, so it proves "
                                                   "nothing: make a new one, or, if nobody has, chmod 600 {0}",
                                                   path.string()));
  return {};
}

Result<std::string> read_secret(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kLargestSecret);
  if (!bytes) return tl::unexpected{bytes.error()};
  if (const auto secret = check_is_secret(path); !secret) return tl::unexpected{secret.error()};
  return std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

Result<std::string> random_hex(std::size_t bytes) {
  std::vector<unsigned char> random(bytes);
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size()))
    return fail(ErrorCode::Internal, "the system has no random numbers");
  std::string text;
  for (const unsigned char byte : random) text += fmt::format("{:02x}", byte);
  return text;
}

Result<void> write_secret(const std::filesystem::path& path, std::string_view text) {
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path{"."};
  std::filesystem::path temporary = path;
  temporary += ".new";
  const auto give_up = [&](std::string_view action) {
    const int error = errno;
    ::unlink(temporary.c_str());
    return fail_system(action, path, error);
  };
  ::unlink(temporary.c_str());  // of a writer that was killed
  if (auto written = write_new_secret(temporary, text); !written) return written;
  struct stat status {};
  if (::geteuid() == 0 &&
      (::stat(folder.c_str(), &status) != 0 || ::chown(temporary.c_str(), status.st_uid, status.st_gid) != 0))
    return give_up("give away");
  if (::rename(temporary.c_str(), path.c_str()) != 0) return give_up("write");
  return sync_folder_of(path);
}

}  // namespace telefab
