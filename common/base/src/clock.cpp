// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/clock.hpp>
#include <thread>

namespace telefab {

Nanoseconds SystemClock::now() const {
  return std::chrono::duration_cast<Nanoseconds>(std::chrono::steady_clock::now().time_since_epoch());
}
Nanoseconds SystemClock::wall() const {
  return std::chrono::duration_cast<Nanoseconds>(std::chrono::system_clock::now().time_since_epoch());
}
void SystemClock::sleep_for(Nanoseconds duration) { std::this_thread::sleep_for(duration); }

}  // namespace telefab
