// SPDX-License-Identifier: GPL-3.0-or-later
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

/// Lanes of a block that belong to a run.
unsigned lanes_of(const SampleRun& run, std::uint32_t block) {
  const std::uint32_t before = 8 * block;
  const unsigned skipped = run.first > before ? run.first - before : 0;
  const unsigned wanted = run.last - before < 8 ? run.last - before : 8;
  return 0xffU << skipped & ((1U << wanted) - 1);
}

__m256i packing(unsigned mask) {
  return _mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(&kPack.order[mask])));
}

template <bool kOneWidth>
std::size_t gather_runs(const GatherInput in, const SampleRun* runs, std::size_t run_count, const GatherOutput out,
                        std::size_t count) {
  const __m256 cx = _mm256_set1_ps(in.x), cy = _mm256_set1_ps(in.y), cz = _mm256_set1_ps(in.z);
  const __m256 cut = _mm256_set1_ps(in.cut_widths), margin = _mm256_set1_ps(in.margin);
  const __m256 scale = _mm256_set1_ps(in.scale), one = _mm256_set1_ps(1.F);
  const auto reach2_of = [&](__m256 width) {
    const __m256 reach = _mm256_add_ps(_mm256_mul_ps(cut, width), margin);
    return _mm256_mul_ps(reach, reach);
  };
  const auto k_of = [&](__m256 width) {
    const __m256 w = _mm256_mul_ps(width, scale);
    return _mm256_div_ps(one, _mm256_mul_ps(w, w));
  };
  __m256 reach2 = reach2_of(_mm256_set1_ps(in.width));
  __m256 k = k_of(_mm256_set1_ps(in.width));
  for (std::size_t r = 0; r < run_count; ++r) {
    const SampleRun run = runs[r];
    for (std::uint32_t block = run.first / 8; 8 * block < run.last; ++block) {
      const float* const place = in.places + 24 * static_cast<std::size_t>(block);
      const float* const normal = in.normals + 24 * static_cast<std::size_t>(block);
      const __m256 dx = _mm256_sub_ps(_mm256_load_ps(place), cx);
      const __m256 dy = _mm256_sub_ps(_mm256_load_ps(place + 8), cy);
      const __m256 dz = _mm256_sub_ps(_mm256_load_ps(place + 16), cz);
      const __m256 r2 =
          _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy)), _mm256_mul_ps(dz, dz));
      if constexpr (!kOneWidth) {
        const __m256 width = _mm256_load_ps(in.widths + 8 * static_cast<std::size_t>(block));
        reach2 = reach2_of(width);
        k = k_of(width);
      }
      // No branch on an empty mask: many are, and nobody can predict which.
      const unsigned mask =
          static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(r2, reach2, _CMP_LT_OQ))) & lanes_of(run, block);
      const __m256i order = packing(mask);
      float* const to = out.floats + count;
      const auto put = [&](std::size_t array, __m256 value) {
        _mm256_storeu_ps(to + array * out.stride, _mm256_permutevar8x32_ps(value, order));
      };
      put(0, _mm256_mul_ps(dx, scale));
      put(1, _mm256_mul_ps(dy, scale));
      put(2, _mm256_mul_ps(dz, scale));
      put(3, _mm256_load_ps(normal));
      put(4, _mm256_load_ps(normal + 8));
      put(5, _mm256_load_ps(normal + 16));
      if constexpr (kOneWidth)
        _mm256_storeu_ps(to + 6 * out.stride, k);
      else
        put(6, k);
      count += static_cast<unsigned>(_mm_popcnt_u32(mask));
    }
  }
  return count;
}

std::size_t gather_avx2(const GatherInput& in, const SampleRun* runs, std::size_t run_count, const GatherOutput& out,
                        std::size_t count) {
  return in.widths != nullptr ? gather_runs<false>(in, runs, run_count, out, count)
                              : gather_runs<true>(in, runs, run_count, out, count);
}

struct Near {
  __m256 x, y, z, nx, ny, nz, radius2;
  explicit Near(const NearInput& in)
      : x{_mm256_set1_ps(in.x)},
        y{_mm256_set1_ps(in.y)},
        z{_mm256_set1_ps(in.z)},
        nx{_mm256_set1_ps(in.nx)},
        ny{_mm256_set1_ps(in.ny)},
        nz{_mm256_set1_ps(in.nz)},
        radius2{_mm256_set1_ps(in.radius2)} {}
  /// Which lanes are near; their squared distances.
  unsigned lanes(const float* place, const float* normal, __m256& r2) const {
    const __m256 dx = _mm256_sub_ps(_mm256_load_ps(place), x);
    const __m256 dy = _mm256_sub_ps(_mm256_load_ps(place + 8), y);
    const __m256 dz = _mm256_sub_ps(_mm256_load_ps(place + 16), z);
    r2 = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy)), _mm256_mul_ps(dz, dz));
    const __m256 along = _mm256_add_ps(
        _mm256_add_ps(_mm256_mul_ps(_mm256_load_ps(normal), nx), _mm256_mul_ps(_mm256_load_ps(normal + 8), ny)),
        _mm256_mul_ps(_mm256_load_ps(normal + 16), nz));
    return static_cast<unsigned>(_mm256_movemask_ps(
        _mm256_and_ps(_mm256_cmp_ps(r2, radius2, _CMP_LE_OQ), _mm256_cmp_ps(along, _mm256_setzero_ps(), _CMP_GE_OQ))));
  }
};

std::size_t distances_avx2(const NearInput& in, const SampleRun* runs, std::size_t run_count, float* distances2) {
  const Near near{in};
  std::size_t count = 0;
  for (std::size_t r = 0; r < run_count; ++r)
    for (std::uint32_t block = runs[r].first / 8; 8 * block < runs[r].last; ++block) {
      const std::size_t at = 24 * static_cast<std::size_t>(block);
      __m256 r2;
      const unsigned mask = near.lanes(in.places + at, in.normals + at, r2) & lanes_of(runs[r], block);
      _mm256_storeu_ps(distances2 + count, _mm256_permutevar8x32_ps(r2, packing(mask)));
      count += static_cast<unsigned>(_mm_popcnt_u32(mask));
    }
  return count;
}

float mean_avx2(const NearInput& in, const SampleRun* runs, std::size_t run_count, const float* values, float other) {
  const Near near{in};
  const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  __m256 sum = _mm256_setzero_ps();
  unsigned count = 0;
  for (std::size_t r = 0; r < run_count; ++r)
    for (std::uint32_t block = runs[r].first / 8; 8 * block < runs[r].last; ++block) {
      const std::size_t at = 24 * static_cast<std::size_t>(block);
      __m256 r2;
      const unsigned mask = near.lanes(in.places + at, in.normals + at, r2) & lanes_of(runs[r], block);
      const __m256i chosen =
          _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(static_cast<int>(mask)), bits), bits);
      const __m256 value = _mm256_load_ps(values + 8 * static_cast<std::size_t>(block));
      sum = _mm256_add_ps(sum, _mm256_and_ps(value, _mm256_castsi256_ps(chosen)));
      count += static_cast<unsigned>(_mm_popcnt_u32(mask));
    }
  if (count == 0) return other;
  alignas(32) float lane[8];
  _mm256_store_ps(lane, sum);
  float total = 0;
  for (const float v : lane) total += v;
  return total / static_cast<float>(count);
}

}  // namespace

KernelSet avx2_kernels() { return {evaluate_lanes<xsimd::avx2>, gather_avx2, distances_avx2, mean_avx2}; }

}  // namespace telefab::scan
#endif
