// SPDX-License-Identifier: GPL-3.0-or-later
#include <sys/file.h>

#include <cerrno>
#include <telefab/base/clock.hpp>
#include <telefab/base/open_file.hpp>

namespace telefab {

int take_lock(const OpenFile& file, std::chrono::milliseconds patience) {
  constexpr auto kLookAgainAfter = std::chrono::milliseconds{10};
  SystemClock clock;  // programs are waited for, which know no other
  const Nanoseconds end = clock.now() + patience;
  while (::flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK || clock.now() >= end) return errno;
    clock.sleep_for(kLookAgainAfter);
  }
  return 0;
}

}  // namespace telefab
