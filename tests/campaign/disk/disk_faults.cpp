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
std::atomic<std::uint64_t> operations{0};
std::array<char, 512> under{};
std::uint64_t fail_at = 0;
int fail_with = 0;
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
bool fails(const char* operation, const char* path) {
  if (!is_counting || path == nullptr || !is_beneath(path)) return false;
  const std::uint64_t number = ++operations;
  if (!is_failing || !(number == fail_at || (stays && number > fail_at))) return false;
  remember(operation, path);
  errno = fail_with;
  return true;
}

bool fails(const char* operation, int file) {
  if (!is_counting) return false;
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
  const ssize_t n = ::readlink(link.data(), path.data(), path.size() - 1);
  errno = before;
  return n > 0 && fails(operation, path.data());
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
  fail_at = plan.at;
  fail_with = plan.error;
  stays = plan.stays;
  operations = 0;
  first_fault[0] = '\0';
  is_failing = plan.at > 0;
  is_counting = true;
}

void end_disk_faults() { is_failing = false; }
std::uint64_t disk_operations() { return operations; }
std::string first_disk_fault() {
  const std::lock_guard lock{first_mutex};
  return first_fault.data();
}

}  // namespace telefab::test

// What the program defines itself comes before what libraries bring, for all of them: libc's names, with the failing
// disk before them.
using telefab::test::fails;
using telefab::test::real;

// NOLINTBEGIN(readability-identifier-naming)
#define TELEFAB_FAILING(Return, name, parameters, arguments, subject) \
  extern "C" Return name parameters {                                 \
    static Return(*next) parameters = nullptr;                        \
    if (fails(#name, subject)) return -1;                             \
    return real(next, #name) arguments;                               \
  }

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

// A file that is made by the call is an operation; one that is opened alone is none.
#define TELEFAB_FAILING_OPEN(name)                                    \
  extern "C" int name(const char* path, int flags, ...) {             \
    static int (*next)(const char*, int, ...) = nullptr;              \
    mode_t mode = 0;                                                  \
    if ((flags & O_CREAT) != 0) {                                     \
      va_list rest;                                                   \
      va_start(rest, flags);                                          \
      mode = va_arg(rest, mode_t);                                    \
      va_end(rest);                                                   \
      if (::access(path, F_OK) != 0 && fails(#name, path)) return -1; \
    }                                                                 \
    return real(next, #name)(path, flags, mode);                      \
  }
TELEFAB_FAILING_OPEN(open)
TELEFAB_FAILING_OPEN(open64)
// NOLINTEND(readability-identifier-naming)
