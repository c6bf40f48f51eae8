// SPDX-License-Identifier: GPL-3.0-or-later
#include "machine_figures.hpp"

#include <malloc.h>

#include <chrono>
#include <fstream>
#include <string>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace telefab::bench {
namespace {

#if defined(__x86_64__)
/// Ten independent chains cover the latency of two units. Returns the sum, so that nothing is optimised away.
__attribute__((target("avx2,fma"))) float multiply_add(std::size_t rounds) {
  __m256 sum[10];
  for (__m256& s : sum) s = _mm256_set1_ps(1.F);
  const __m256 a = _mm256_set1_ps(0.999F);
  const __m256 b = _mm256_set1_ps(0.001F);
  for (std::size_t i = 0; i < rounds; ++i)
#pragma GCC unroll 10
    for (__m256& s : sum) s = _mm256_fmadd_ps(s, a, b);
  for (const __m256& s : sum) sum[0] = _mm256_add_ps(sum[0], s);
  return _mm256_cvtss_f32(sum[0]);
}
#endif

std::size_t status_bytes(const std::string& field) {
  std::ifstream status{"/proc/self/status"};
  for (std::string word; status >> word;)
    if (word == field) {
      std::size_t kilobytes = 0;
      status >> kilobytes;
      return kilobytes * 1024;
    }
  return 0;
}

}  // namespace

std::optional<double> fma_peak_gflops() {
#if defined(__x86_64__)
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return std::nullopt;
  constexpr std::size_t kRounds = 2'000'000;
  double best = 0;
  for (int i = 0; i < 5; ++i) {
    const auto start = std::chrono::steady_clock::now();
    const volatile float kept = multiply_add(kRounds);
    (void)kept;
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    best = std::max(best, 160.0 * kRounds / took.count() * 1e-9);
  }
  return best;
#else
  return std::nullopt;
#endif
}

void reset_peak_memory() {
  malloc_trim(0);
  std::ofstream{"/proc/self/clear_refs"} << "5";
}
std::size_t peak_memory() { return status_bytes("VmHWM:"); }
std::size_t resident_memory() {
  malloc_trim(0);
  return status_bytes("VmRSS:");
}

}  // namespace telefab::bench
