// SPDX-License-Identifier: GPL-3.0-or-later
#include "kernel_lanes.hpp"

namespace telefab::scan {
namespace {

#if defined(__x86_64__)
using Baseline = xsimd::sse2;
#else
using Baseline = xsimd::default_arch;
#endif

std::size_t gather_baseline(const GatherInput& in, const SampleRun* runs, std::size_t run_count,
                            const GatherOutput& out, std::size_t count) {
  for (std::size_t r = 0; r < run_count; ++r)
    for (std::size_t i = runs[r].first; i < runs[r].last; ++i) {
      const float* const place = in.places + 24 * (i / 8) + i % 8;
      const float dx = place[0] - in.x;
      const float dy = place[8] - in.y;
      const float dz = place[16] - in.z;
      const float width = in.widths != nullptr ? in.widths[i] : in.width;
      const float reach = in.cut_widths * width + in.margin;
      if (!(dx * dx + dy * dy + dz * dz < reach * reach)) continue;
      const float* const normal = in.normals + 24 * (i / 8) + i % 8;
      const float w = width * in.scale;
      float* const to = out.floats + count++;
      to[0] = dx * in.scale;
      to[out.stride] = dy * in.scale;
      to[2 * out.stride] = dz * in.scale;
      to[3 * out.stride] = normal[0];
      to[4 * out.stride] = normal[8];
      to[5 * out.stride] = normal[16];
      to[6 * out.stride] = 1 / (w * w);
    }
  return count;
}

/// Calls take(sample, squared distance) for the near ones.
template <class Take>
void each_near(const NearInput& in, const SampleRun* runs, std::size_t run_count, Take&& take) {
  for (std::size_t r = 0; r < run_count; ++r)
    for (std::size_t i = runs[r].first; i < runs[r].last; ++i) {
      const float* const place = in.places + 24 * (i / 8) + i % 8;
      const float* const normal = in.normals + 24 * (i / 8) + i % 8;
      const float dx = place[0] - in.x;
      const float dy = place[8] - in.y;
      const float dz = place[16] - in.z;
      const float r2 = dx * dx + dy * dy + dz * dz;
      const float along = normal[0] * in.nx + normal[8] * in.ny + normal[16] * in.nz;
      if (r2 <= in.radius2 && along >= 0) take(i, r2);
    }
}

std::size_t distances_baseline(const NearInput& in, const SampleRun* runs, std::size_t run_count, float* distances2) {
  std::size_t count = 0;
  each_near(in, runs, run_count, [&](std::size_t, float r2) { distances2[count++] = r2; });
  return count;
}

float mean_baseline(const NearInput& in, const SampleRun* runs, std::size_t run_count, const float* values,
                    float other) {
  float lane[8] = {};
  std::size_t count = 0;
  each_near(in, runs, run_count, [&](std::size_t i, float) {
    lane[i % 8] += values[i];
    ++count;
  });
  float total = 0;
  for (const float v : lane) total += v;
  return count > 0 ? total / static_cast<float>(count) : other;
}

}  // namespace

KernelSet baseline_kernels() { return {evaluate_lanes<Baseline>, gather_baseline, distances_baseline, mean_baseline}; }

KernelSet fastest_kernels() {
#ifdef TELEFAB_KERNEL_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("popcnt")) return avx2_kernels();
#endif
  return baseline_kernels();
}

}  // namespace telefab::scan
