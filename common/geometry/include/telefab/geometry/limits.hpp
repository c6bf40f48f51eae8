// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>

namespace telefab {

/// Bounds that every reader, decoder and slicer keeps, so that one hostile number cannot take the machine.
inline constexpr std::uint32_t kMaxLayers = 200'000;
inline constexpr std::uint32_t kMaxRingsPerLayer = 100'000;
inline constexpr std::uint32_t kMaxVerticesPerLayer = 4'000'000;
inline constexpr double kMaxCoordinateMm = 10'000;

}  // namespace telefab
