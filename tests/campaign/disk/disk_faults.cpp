// SPDX-License-Identifier: GPL-3.0-or-later
#include "disk_faults.hpp"

#include <dlfcn.h>
#include <fcntl.h>
#include <stdarg.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <mutex>
#include <string_view>

namespace telefab::test {
namespace {

// Read by every write of the process, also before main: plain memory, no constructors that may come too late.
std::atomic<bool> is_counting{false};
std::atomic<bool> is_failing{false};
thread_local bool is_sound_here = false;
std::array<std::atomic<std::uint64_t>, kDiskCalls> operations{};
std::array<char, 512> under{};
std::array<char, 64> ending{};
std::uint64_t fail_at = 0;
int fail_with = 0;
DiskCalls failing = DiskCalls::Writes;
bool stays = false;
std::mutex first_mutex;
std::array<char, 600> first_fault{};

bool is_beneath(const char* path) {
  const std::string_view folder{under.data()};
  const std::string_view name{path};
  return name.starts_with(folder) && name.size() > folder.size() && name[folder.size()] == '/';
}

void remember(const char* operation, const char* path) {
  const std::lock_guard lock{first_mutex};
  if (first_fault[0] != '\0') return;
  std::size_t at = 0;
  for (const char* text : {operation, " ", path})
    for (; *text != '\0' && at + 1 < first_fault.size(); ++text) first_fault[at++] = *text;
  first_fault[at] = '\0';
}

/// Counts the operation; whether it fails, with errno set.
bool fails(DiskCalls calls, const char* operation, const char* path) {
  if (!is_counting || is_sound_here || path == nullptr || !is_beneath(path) ||
      !std::string_view{path}.ends_with(ending.data()))
    return false;
  const std::uint64_t number = ++operations[static_cast<std::size_t>(calls)];
  if (!is_failing || calls != failing || !(number == fail_at || (stays && number > fail_at))) return false;
  remember(operation, path);
  errno = fail_with;
  return true;
}

/// The path of what is open, as /proc has it; empty where there is none.
std::array<char, 512> path_of(int file) {
  std::array<char, 64> link{};
  constexpr std::string_view kDescriptors = "/proc/self/fd/";
  kDescriptors.copy(link.data(), kDescriptors.size());
  std::size_t at = kDescriptors.size();
  std::array<char, 16> digits{};
  std::size_t count = 0;
  for (int rest = file; rest > 0 || count == 0; rest /= 10) digits[count++] = static_cast<char>('0' + rest % 10);
  while (count > 0) link[at++] = digits[--count];
  std::array<char, 512> path{};
  const int before = errno;
  if (::readlink(link.data(), path.data(), path.size() - 1) < 0) path[0] = '\0';
  errno = before;
  return path;
}

bool fails(DiskCalls calls, const char* operation, int file) {
  if (!is_counting) return false;
  const auto path = path_of(file);
  return path[0] != '\0' && fails(calls, operation, path.data());
}

/// A name in an open folder, as unlinkat has it.
bool fails_in(DiskCalls calls, const char* operation, int folder, const char* name) {
  if (!is_counting) return false;
  if (name[0] == '/' || folder == AT_FDCWD) return fails(calls, operation, name);
  auto path = path_of(folder);
  std::size_t at = std::string_view{path.data()}.size();
  if (at == 0) return false;
  path[at++] = '/';
  for (const char* each = name; *each != '\0' && at + 1 < path.size(); ++each) path[at++] = *each;
  path[std::min(at, path.size() - 1)] = '\0';
  return fails(calls, operation, path.data());
}

template <class Function>
Function* real(Function*& kept, const char* name) {
  if (kept == nullptr) kept = reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
  return kept;
}

}  // namespace

void begin_disk_faults(const DiskFaultPlan& plan) {
  is_counting = is_failing = false;
  plan.under.copy(under.data(), under.size() - 1);
  under[std::min(plan.under.size(), under.size() - 1)] = '\0';
  ending.fill('\0');
  plan.ending.copy(ending.data(), ending.size() - 1);
  fail_at = plan.at;
  fail_with = plan.error;
  failing = plan.calls;
  stays = plan.stays;
  for (auto& each : operations) each = 0;
  first_fault[0] = '\0';
  is_failing = plan.at > 0;
  is_counting = true;
}

SoundDisk::SoundDisk() { is_sound_here = true; }
SoundDisk::~SoundDisk() { is_sound_here = false; }

void end_disk_faults() { is_failing = false; }
std::uint64_t disk_operations(DiskCalls calls) { return operations[static_cast<std::size_t>(calls)]; }
std::string first_disk_fault() {
  const std::lock_guard lock{first_mutex};
  return first_fault.data();
}

}  // namespace telefab::test

// What the program defines itself comes before what libraries bring, for all of them: libc's names, with the failing
// disk before them.
using telefab::test::DiskCalls;
using telefab::test::fails;
using telefab::test::real;

// NOLINTBEGIN(readability-identifier-naming)
#define TELEFAB_FAILING_CALL(calls, Return, name, parameters, arguments, subject) \
  extern "C" Return name parameters {                                             \
    static Return(*next) parameters = nullptr;                                    \
    if (fails(DiskCalls::calls, #name, subject)) return -1;                       \
    return real(next, #name) arguments;                                           \
  }
#define TELEFAB_FAILING(Return, name, parameters, arguments, subject) \
  TELEFAB_FAILING_CALL(Writes, Return, name, parameters, arguments, subject)

TELEFAB_FAILING(ssize_t, write, (int file, const void* bytes, size_t size), (file, bytes, size), file)
TELEFAB_FAILING(ssize_t, pwrite, (int file, const void* bytes, size_t size, off_t at), (file, bytes, size, at), file)
TELEFAB_FAILING(ssize_t, pwrite64, (int file, const void* bytes, size_t size, off64_t at), (file, bytes, size, at),
                file)
TELEFAB_FAILING(ssize_t, writev, (int file, const iovec* parts, int count), (file, parts, count), file)
TELEFAB_FAILING(int, fsync, (int file), (file), file)
TELEFAB_FAILING(int, fdatasync, (int file), (file), file)
TELEFAB_FAILING(int, ftruncate, (int file, off_t size) noexcept, (file, size), file)
TELEFAB_FAILING(int, ftruncate64, (int file, off64_t size) noexcept, (file, size), file)
TELEFAB_FAILING(int, truncate, (const char* path, off_t size) noexcept, (path, size), path)
TELEFAB_FAILING(int, fallocate, (int file, int mode, off_t at, off_t size), (file, mode, at, size), file)
TELEFAB_FAILING(int, fallocate64, (int file, int mode, off64_t at, off64_t size), (file, mode, at, size), file)
TELEFAB_FAILING(int, mkdir, (const char* path, mode_t mode) noexcept, (path, mode), path)
TELEFAB_FAILING(int, rename, (const char* from, const char* to) noexcept, (from, to), to)
TELEFAB_FAILING(int, mkstemp, (char* pattern), (pattern), pattern)
TELEFAB_FAILING(int, mkostemp, (char* pattern, int flags), (pattern, flags), pattern)
TELEFAB_FAILING(int, mkostemp64, (char* pattern, int flags), (pattern, flags), pattern)
TELEFAB_FAILING(int, mkstemp64, (char* pattern), (pattern), pattern)
TELEFAB_FAILING(ssize_t, sendfile64, (int to, int from, off64_t* at, size_t size) noexcept, (to, from, at, size), to)
TELEFAB_FAILING(int, syncfs, (int file) noexcept, (file), file)
TELEFAB_FAILING(int, link, (const char* from, const char* to) noexcept, (from, to), to)
TELEFAB_FAILING_CALL(Reads, ssize_t, read, (int file, void* bytes, size_t size), (file, bytes, size), file)
TELEFAB_FAILING_CALL(Reads, ssize_t, pread, (int file, void* bytes, size_t size, off_t at), (file, bytes, size, at),
                     file)
TELEFAB_FAILING_CALL(Reads, ssize_t, pread64, (int file, void* bytes, size_t size, off64_t at), (file, bytes, size, at),
                     file)
TELEFAB_FAILING_CALL(Reads, ssize_t, readv, (int file, const iovec* parts, int count), (file, parts, count), file)
TELEFAB_FAILING_CALL(Removes, int, unlink, (const char* path) noexcept, (path), path)
TELEFAB_FAILING_CALL(Removes, int, rmdir, (const char* path) noexcept, (path), path)
TELEFAB_FAILING_CALL(Removes, int, remove, (const char* path) noexcept, (path), path)
extern "C" int unlinkat(int folder, const char* name, int flags) noexcept {
  static int (*next)(int, const char*, int) = nullptr;
  if (telefab::test::fails_in(DiskCalls::Removes, "unlinkat", folder, name)) return -1;
  return real(next, "unlinkat")(folder, name, flags);
}

// A file that is made by the call is an operation; one that is opened alone is none.
#define TELEFAB_FAILING_OPEN(name)                                                       \
  extern "C" int name(const char* path, int flags, ...) {                                \
    static int (*next)(const char*, int, ...) = nullptr;                                 \
    mode_t mode = 0;                                                                     \
    if ((flags & O_CREAT) != 0) {                                                        \
      va_list rest;                                                                      \
      va_start(rest, flags);                                                             \
      mode = va_arg(rest, mode_t);                                                       \
      va_end(rest);                                                                      \
      if (::access(path, F_OK) != 0 && fails(DiskCalls::Writes, #name, path)) return -1; \
    }                                                                                    \
    return real(next, #name)(path, flags, mode);                                         \
  }
TELEFAB_FAILING_OPEN(open)
TELEFAB_FAILING_OPEN(open64)
// NOLINTEND(readability-identifier-naming)
