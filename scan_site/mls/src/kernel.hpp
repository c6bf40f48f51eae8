// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>

// Seen by the files compiled for special instruction sets: no header with inline code of ours or Eigen's in here.
namespace telefab::scan {

/// Neighbours of a query, one array a coordinate. Count is a multiple of kLanes, arrays are 32-byte aligned; lengths
/// are in units of the reference width, relative to the gather centre; padding lies far away.
struct KernelInput {
  std::size_t count;
  const float* x;
  const float* y;
  const float* z;
  const float* nx;
  const float* ny;
  const float* nz;
  const float* k;  ///< 1 / h^2 of the neighbour
  float* theta;    ///< work space, count long
};

struct KernelOutput {
  double weight = 0;     ///< sum of theta
  double value = 0;      ///< field, in reference widths
  double closeness = 0;  ///< IMLS value
  double gradient[3] = {0, 0, 0};
};

/// Sums run in eight lanes on every machine and meet in one order, and nothing is contracted: all versions give the
/// same bytes.
inline constexpr std::size_t kLanes = 8;
/// theta is cut at exp(-kCut): 3.16 widths.
inline constexpr float kCut = 10.0F;

enum class KernelForm : std::uint8_t { Unbiased, Paper, PaperLiteral, Imls };
using KernelFunction = KernelOutput (*)(const KernelInput&, KernelForm form, float x, float y, float z);

/// Samples [first, last) of a grid's order.
struct SampleRun {
  std::uint32_t first;
  std::uint32_t last;
};

/// Which samples to copy: those nearer to the centre than cut_widths * h + margin, h their own width.
struct GatherInput {
  const float* places;   ///< blocks of eight samples: 8 x, 8 y, 8 z, 32-byte aligned
  const float* normals;  ///< likewise
  const float* widths;   ///< one a sample, 32-byte aligned; null: `width` for all
  float width;
  float x, y, z;  ///< the centre
  float cut_widths;
  float margin;
  float scale;  ///< 1 / reference width
};

/// Where they go: seven arrays as of KernelInput, `stride` floats apart, aligned so. Room for eight more than come.
struct GatherOutput {
  float* floats;
  std::size_t stride;
};

/// Appends what it finds in the runs, in their order, behind `count` neighbours. Returns the new count.
using GatherFunction = std::size_t (*)(const GatherInput& in, const SampleRun* runs, std::size_t run_count,
                                       const GatherOutput& out, std::size_t count);

/// Samples about a place whose normals do not oppose a direction.
struct NearInput {
  const float* places;   ///< as of GatherInput
  const float* normals;  ///< likewise
  float x, y, z;         ///< the place
  float nx, ny, nz;      ///< the direction
  float radius2;         ///< nearer than or at this squared distance
};
/// Writes their squared distances behind each other, room for eight more than come. Returns how many there are.
using DistancesFunction = std::size_t (*)(const NearInput& in, const SampleRun* runs, std::size_t run_count,
                                          float* distances2);
/// Mean of their values (one a sample, 32-byte aligned); `other` where there are none.
using MeanFunction = float (*)(const NearInput& in, const SampleRun* runs, std::size_t run_count, const float* values,
                               float other);

struct KernelSet {
  KernelFunction evaluate;
  GatherFunction gather;
  DistancesFunction distances;
  MeanFunction mean;
};

[[nodiscard]] KernelSet baseline_kernels();
#ifdef TELEFAB_KERNEL_AVX2
[[nodiscard]] KernelSet avx2_kernels();
#endif
/// The fastest version this machine can run. TELEFAB is deterministic either way.
[[nodiscard]] KernelSet fastest_kernels();

}  // namespace telefab::scan
