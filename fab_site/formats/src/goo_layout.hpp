// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

// GOO v3, as Elegoo's "Goo-Format-Spec V1.2" lays it out: big-endian; lengths in millimetres, speeds in mm/min, times
// in seconds, all of them 32-bit floats.

namespace telefab::fab::goo {

inline constexpr std::string_view kVersion = "V3.0";
inline constexpr std::array<std::uint8_t, 8> kMagic{0x07, 0x00, 0x00, 0x00, 0x44, 0x4C, 0x50, 0x00};
inline constexpr std::uint16_t kDelimiter = 0x0D0A;
/// The one printer whose files have the low byte first; they are read and not written.
inline constexpr std::string_view kLittleEndianModel = "ELEGOO Jupiter 2";

inline constexpr std::uint32_t kSmallPreview_px = 116;
inline constexpr std::uint32_t kBigPreview_px = 290;
inline constexpr std::size_t kHeaderBytes = 195'477;
inline constexpr std::size_t kModelAt = 92;
inline constexpr std::size_t kModelBytes = 32;
inline constexpr std::size_t kLayerBytes = 70;  ///< of a definition with the size of what follows
inline constexpr std::size_t kEndBytes = 11;    ///< three zeros and the magic

}  // namespace telefab::fab::goo
