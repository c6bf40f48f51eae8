// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>

// Numbers of the Common Layer Interface 2.00, chapter on the binary format; little-endian throughout.
namespace telefab::fab {

inline constexpr std::uint16_t kCliLayerLong = 127;      ///< z as a 32-bit real
inline constexpr std::uint16_t kCliLayerShort = 128;     ///< z as a 16-bit whole number
inline constexpr std::uint16_t kCliPolylineShort = 129;  ///< id, dir, n, then coordinates, all 16 bits
inline constexpr std::uint16_t kCliPolylineLong = 130;   ///< id, dir, n of 32 bits, then 32-bit reals
inline constexpr std::uint16_t kCliHatchesShort = 131;   ///< id, n, then 4 n coordinates of 16 bits
inline constexpr std::uint16_t kCliHatchesLong = 132;    ///< id, n of 32 bits, then 4 n 32-bit reals

inline constexpr std::uint32_t kCliClockwise = 0;         ///< internal, a hole
inline constexpr std::uint32_t kCliCounterClockwise = 1;  ///< external
inline constexpr std::uint32_t kCliOpenLine = 2;

}  // namespace telefab::fab
