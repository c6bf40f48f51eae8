#include "kernel.hpp"
#ifdef TELEFAB_KERNEL_AVX2
#include <immintrin.h>

#include "kernel_lanes.hpp"

namespace telefab::scan {
namespace {

/// For every mask of eight lanes the lanes that are set, first ones first: one byte a lane.
struct PackTable {
  alignas(64) std::uint64_t order[256];
  constexpr PackTable() : order{} {
    for (unsigned mask = 0; mask < 256; ++mask) {
      unsigned place = 0;
      for (unsigned lane = 0; lane < 8; ++lane)
        if ((mask >> lane & 1U) != 0) order[mask] |= static_cast<std::uint64_t>(lane) << (8 * place++);
    }
  }
};
constexpr PackTable kPack;

std::size_t gather_avx2(const GatherInput& in, const SampleRun* runs, std::size_t run_count, const GatherOutput& out,
                        std::size_t count) {
  const __m256 cx = _mm256_set1_ps(in.x), cy = _mm256_set1_ps(in.y), cz = _mm256_set1_ps(in.z);
  const __m256 cut = _mm256_set1_ps(in.cut_widths), margin = _mm256_set1_ps(in.margin);
  const __m256 scale = _mm256_set1_ps(in.scale), one = _mm256_set1_ps(1.F);
  __m256 width = _mm256_set1_ps(in.width);
  for (std::size_t r = 0; r < run_count; ++r) {
    const std::uint32_t end = (runs[r].last + 7) / 8;
    for (std::uint32_t block = runs[r].first / 8; block < end; ++block) {
      const float* const place = in.places + 24 * static_cast<std::size_t>(block);
      const __m256 dx = _mm256_sub_ps(_mm256_load_ps(place), cx);
      const __m256 dy = _mm256_sub_ps(_mm256_load_ps(place + 8), cy);
      const __m256 dz = _mm256_sub_ps(_mm256_load_ps(place + 16), cz);
      const __m256 r2 =
          _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy)), _mm256_mul_ps(dz, dz));
      if (in.widths != nullptr) width = _mm256_load_ps(in.widths + 8 * static_cast<std::size_t>(block));
      const __m256 reach = _mm256_add_ps(_mm256_mul_ps(cut, width), margin);
      auto mask = static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(r2, _mm256_mul_ps(reach, reach), _CMP_LT_OQ)));
      const std::uint32_t before = 8 * block;
      if (runs[r].first > before) mask &= 0xffU << (runs[r].first - before);
      if (runs[r].last < before + 8) mask &= 0xffU >> (before + 8 - runs[r].last);
      if (mask == 0) continue;
      const __m256i order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(&kPack.order[mask])));
      const auto put = [&](std::size_t array, __m256 value) {
        _mm256_storeu_ps(out.floats + array * out.stride + count, _mm256_permutevar8x32_ps(value, order));
      };
      const float* const normal = in.normals + 24 * static_cast<std::size_t>(block);
      const __m256 w = _mm256_mul_ps(width, scale);
      put(0, _mm256_mul_ps(dx, scale));
      put(1, _mm256_mul_ps(dy, scale));
      put(2, _mm256_mul_ps(dz, scale));
      put(3, _mm256_load_ps(normal));
      put(4, _mm256_load_ps(normal + 8));
      put(5, _mm256_load_ps(normal + 16));
      put(6, _mm256_div_ps(one, _mm256_mul_ps(w, w)));
      count += static_cast<unsigned>(__builtin_popcount(mask));
    }
  }
  return count;
}

}  // namespace

KernelSet avx2_kernels() { return {evaluate_lanes<xsimd::avx2>, gather_avx2}; }

}  // namespace telefab::scan
#endif
