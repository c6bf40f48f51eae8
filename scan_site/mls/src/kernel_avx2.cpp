#include "kernel.hpp"
#ifdef TELEFAB_KERNEL_AVX2
#include "kernel_lanes.hpp"

namespace telefab::scan {

KernelOutput evaluate_avx2(const KernelInput& in, KernelForm form, float x, float y, float z) {
  return evaluate_lanes<xsimd::avx2>(in, form, x, y, z);
}

}  // namespace telefab::scan
#endif
