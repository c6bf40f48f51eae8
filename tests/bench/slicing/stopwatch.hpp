// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <ctime>

namespace telefab::bench {

/// What all threads of the process together have worked.
struct Stopwatch {
  static double cpu_now() {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  }
  double cpu = cpu_now();
  /// Seconds of work since the last call.
  double lap() {
    const double before = cpu;
    cpu = cpu_now();
    return cpu - before;
  }
};

}  // namespace telefab::bench
