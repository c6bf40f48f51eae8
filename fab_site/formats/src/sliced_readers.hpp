// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>

#include <cmath>
#include <telefab/fab/formats/sliced_file.hpp>

#include "zip_reader.hpp"

namespace telefab::fab {

inline constexpr std::uint64_t kMostSlicedPixels = 1ULL << 27U;
inline constexpr std::size_t kMostSlicedLayers = 99'999;
inline constexpr double kMostExposure_s = 3600;

// One reader a format; each fails as read_sliced_file.
[[nodiscard]] Result<std::unique_ptr<SlicedFile>> read_goo(std::span<const std::byte> bytes);
[[nodiscard]] Result<std::unique_ptr<SlicedFile>> read_sl1(ZipReader archive);
[[nodiscard]] Result<std::unique_ptr<SlicedFile>> read_nanodlp(ZipReader archive);

/// Seconds as a plan keeps them.
[[nodiscard]] inline std::chrono::microseconds exposure_of(double seconds) {
  return std::chrono::microseconds{std::llround(seconds * 1e6)};
}

/// Exposure of a layer in a job of bottom layers, even steps behind them, and the rest.
[[nodiscard]] double stepped_exposure_s(std::uint32_t layer, std::uint32_t bottom_layers, std::uint32_t steps,
                                        double bottom_s, double normal_s);

/// The PNG of a layer as the grey mask that it is. InvalidInput where it is coloured or of another size than
/// `expected`; no size: any.
[[nodiscard]] Result<Mask> grey_mask(const std::string& png, std::optional<PixelSize> expected, std::string_view name);

}  // namespace telefab::fab
