#include "kernel_lanes.hpp"

namespace telefab::scan {

#if defined(__x86_64__)
using Baseline = xsimd::sse2;
#else
using Baseline = xsimd::default_arch;
#endif

KernelOutput evaluate_baseline(const KernelInput& in, KernelForm form, float x, float y, float z) {
  return evaluate_lanes<Baseline>(in, form, x, y, z);
}

KernelFunction fastest_kernel() {
#ifdef TELEFAB_KERNEL_AVX2
  if (__builtin_cpu_supports("avx2")) return evaluate_avx2;
#endif
  return evaluate_baseline;
}

}  // namespace telefab::scan
