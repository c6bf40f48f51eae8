// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <telefab/base/file.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/transfer/second_name.hpp>
#include <vector>

namespace telefab {
namespace {

constexpr std::size_t kBlock_bytes = 1U << 20U;

/// What link(2) answers where it is not the file's fault. FAT and SMB answer EPERM, others ENOTSUP.
bool means_no_second_names(int error) {
  return error == EXDEV || error == EPERM || error == EMLINK || error == EOPNOTSUPP || error == ENOTSUP ||
         error == ENOSYS;
}

Result<void> copy_bytes(int from, int to, const std::filesystem::path& path, const std::stop_token& stop) {
  std::vector<std::byte> block(kBlock_bytes);
  while (true) {
    if (stop.stop_requested()) return cancelled("copying a file");
    const ssize_t got = ::read(from, block.data(), block.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return fail_system("read what is copied to", path, errno);
    if (got == 0) return {};
    for (ssize_t at = 0; at < got;) {
      const ssize_t n = ::write(to, block.data() + at, static_cast<std::size_t>(got - at));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return fail_system("copy to", path, errno);
      at += n;
    }
  }
}

}  // namespace

Result<bool> give_second_name(const std::filesystem::path& from, const std::filesystem::path& to,
                              const LinkCall& call) {
  const int error = call ? call(from.c_str(), to.c_str()) : ::link(from.c_str(), to.c_str()) == 0 ? 0 : errno;
  if (error == 0) return true;
  if (means_no_second_names(error)) return false;
  return fail_system("give a second name to", from, error);
}

Result<void> copy_whole(const std::filesystem::path& from, const std::filesystem::path& to,
                        const std::stop_token& stop) {
  const OpenFile source{::open(from.c_str(), O_RDONLY | O_CLOEXEC)};
  if (source.get() < 0) return fail_system("read", from, errno);
  const auto temporary = make_temporary_beside(to);
  if (!temporary) return tl::unexpected{temporary.error()};
  const auto copied = [&]() -> Result<void> {
    const OpenFile target{::open(temporary->c_str(), O_WRONLY | O_CLOEXEC)};
    if (target.get() < 0) return fail_system("write", *temporary, errno);
    return copy_bytes(source.get(), target.get(), *temporary, stop);
  }();
  if (copied) return put_in_place(*temporary, to);
  ::unlink(temporary->c_str());
  return copied;
}

}  // namespace telefab
