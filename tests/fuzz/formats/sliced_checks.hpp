// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdlib>
#include <telefab/fab/formats/sliced_file.hpp>

namespace telefab::fab {

/// What must hold of any bytes: an error that is not a fault of ours, or a job whose layers rise, whose numbers are
/// finite and whose masks are of its size or refused. Masks of more than a million pixels are not unpacked here.
inline void check_sliced(std::span<const std::byte> bytes) {
  const auto bad = [](const Error& error) { return error.code == ErrorCode::Internal || error.what.empty(); };
  const auto file = read_sliced_file(bytes);
  if (!file) {
    if (bad(file.error())) std::abort();
    return;
  }
  const SlicedJob& job = (*file)->job();
  if (job.layers.empty() || job.size.width_px == 0 || job.size.height_px == 0 || !(job.thickness_mm > 0)) std::abort();
  double below_mm = 0;
  for (const SlicedLayer& layer : job.layers) {
    if (!(layer.z_mm > below_mm) || layer.exposure.count() < 0 || layer.exposure > std::chrono::hours{1}) std::abort();
    if (!(layer.light_share >= 0 && layer.light_share <= 1)) std::abort();
    for (const double value : {layer.motion.lift_mm, layer.motion.lift_speed_mm_per_s, layer.motion.settle_s,
                               layer.motion.wait_after_lift_s, layer.motion.lower_speed_mm_per_s})
      if (!(value >= 0 && value <= 1e6)) std::abort();
    below_mm = layer.z_mm;
  }
  constexpr std::uint32_t kMostPixels = 1'000'000;
  if (std::uint64_t{job.size.width_px} * job.size.height_px > kMostPixels) return;
  for (std::uint32_t i = 0; i < job.layers.size() && i < 8; ++i) {
    const auto mask = (*file)->mask(LayerIndex{i});
    if (!mask ? bad(mask.error())
              : mask->size != job.size || mask->rows.size() != std::size_t{job.size.width_px} * job.size.height_px)
      std::abort();
  }
}

}  // namespace telefab::fab
