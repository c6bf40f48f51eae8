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
using KernelFunction = KernelOutput (*)(const KernelInput&, KernelForm, float x, float y, float z);

[[nodiscard]] KernelOutput evaluate_baseline(const KernelInput& in, KernelForm form, float x, float y, float z);
#ifdef TELEFAB_KERNEL_AVX2
[[nodiscard]] KernelOutput evaluate_avx2(const KernelInput& in, KernelForm form, float x, float y, float z);
#endif
/// The fastest version this machine can run. TELEFAB is deterministic either way.
[[nodiscard]] KernelFunction fastest_kernel();

}  // namespace telefab::scan
