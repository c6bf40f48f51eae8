// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_bytes.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <telefab/base/exit_code.hpp>
#include <telefab/base/file.hpp>
#include <utility>

#include "cloud_files.hpp"

namespace telefab::scan {
namespace {

/// Smaller files are read as ever.
constexpr std::uint64_t kMappedFrom = 64ULL << 20U;
/// So many bytes are digested before they may go.
constexpr std::size_t kStride = std::size_t{64} << 20U;

/// What is written where a page of a mapped file is not there any more: the file that was mapped last is named, and a
/// program maps one. Made beforehand, for nothing can be made then.
std::string& last_words() {
  static std::string words;
  return words;
}

void file_is_gone(int signal, siginfo_t* about, void*) {
  if (about->si_code == BUS_ADRERR) {
    (void)!::write(STDERR_FILENO, last_words().data(), last_words().size());
    ::_exit(static_cast<int>(ExitCode::Storage));
  }
  ::signal(signal, SIG_DFL);
  ::raise(signal);
}

void watch_for_shorter(const std::filesystem::path& file) {
  last_words() = fmt::format("telefab-scan: {} became shorter while it was read; try again\n", file.string());
  struct sigaction action {};
  action.sa_sigaction = file_is_gone;
  action.sa_flags = SA_SIGINFO;
  ::sigaction(SIGBUS, &action, nullptr);
}

}  // namespace

Result<ScanBytes> ScanBytes::of(const std::filesystem::path& file) {
  ScanBytes made;
  struct stat status {};
  const bool is_large = ::stat(file.c_str(), &status) == 0 && S_ISREG(status.st_mode) &&
                        static_cast<std::uint64_t>(status.st_size) >= kMappedFrom;
  if (!is_large) {
    auto read = read_file(file, kMaxScanFileBytes);
    if (!read) return tl::unexpected{read.error()};
    made.read_ = std::move(*read);
    made.bytes_ = made.read_;
    return made;
  }
  made.file_ = file;
  made.mapped_ = OpenFile{::open(file.c_str(), O_RDONLY | O_CLOEXEC)};
  if (made.mapped_.get() < 0 || ::fstat(made.mapped_.get(), &made.when_mapped_) != 0)
    return fail_system("read", file, errno);
  const auto size = static_cast<std::size_t>(made.when_mapped_.st_size);
  watch_for_shorter(file);
  void* const at = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, made.mapped_.get(), 0);
  if (at == MAP_FAILED) return fail_system("read", file, errno);
  (void)::madvise(at, size, MADV_SEQUENTIAL);  // advice alone
  made.bytes_ = {static_cast<const std::byte*>(at), size};
  return made;
}

ScanBytes::ScanBytes(ScanBytes&& other) noexcept
    : read_{std::move(other.read_)},
      bytes_{std::exchange(other.bytes_, {})},
      mapped_{std::move(other.mapped_)},
      when_mapped_{other.when_mapped_},
      file_{std::move(other.file_)} {}

ScanBytes::~ScanBytes() {
  if (mapped_.get() >= 0 && !bytes_.empty()) ::munmap(const_cast<std::byte*>(bytes_.data()), bytes_.size());
}

void ScanBytes::let_go() const {
  if (mapped_.get() >= 0) (void)::madvise(const_cast<std::byte*>(bytes_.data()), bytes_.size(), MADV_DONTNEED);
}

Result<void> ScanBytes::is_unchanged() const {
  if (mapped_.get() < 0) return {};
  struct stat now {};
  if (::fstat(mapped_.get(), &now) != 0) return fail_system("read", file_, errno);
  const auto same = [](const timespec& a, const timespec& b) { return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec; };
  if (now.st_size == when_mapped_.st_size && same(now.st_mtim, when_mapped_.st_mtim)) return {};
  return fail(ErrorCode::Conflict, fmt::format("{} was written to while it was read; try again", file_.string()));
}

Digest ScanBytes::digest() const {
  Hasher hasher;
  for (std::size_t at = 0; at < bytes_.size(); at += kStride) {
    hasher.feed(bytes_.subspan(at, std::min(kStride, bytes_.size() - at)));
    let_go();
  }
  return hasher.digest();
}

}  // namespace telefab::scan
