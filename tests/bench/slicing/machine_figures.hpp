// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>

namespace telefab::bench {

/// What one core can do at most: fused multiply-adds of eight floats, measured now, in GFlop/s. None without AVX2
/// and FMA.
[[nodiscard]] std::optional<double> fma_peak_gflops();

/// Forgets the process's peak of resident memory, where the system allows it.
void reset_peak_memory();
/// Peak of resident memory since the last reset, bytes; 0 where the system does not tell.
[[nodiscard]] std::size_t peak_memory();
/// Resident now, bytes. Memory freed to the allocator is given back first.
[[nodiscard]] std::size_t resident_memory();

}  // namespace telefab::bench
