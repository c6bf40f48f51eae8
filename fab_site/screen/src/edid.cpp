// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <telefab/fab/screen/edid.hpp>

namespace telefab::fab {

namespace {

constexpr std::size_t kBlock_bytes = 128;
constexpr std::array<std::uint8_t, 8> kHeader{0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0};
constexpr std::size_t kMaker = 8, kProduct = 10, kSerial = 12, kDescriptors = 54, kDescriptor_bytes = 18;
constexpr std::uint8_t kNameTag = 0xFC;
constexpr std::size_t kNameText = 5;

}  // namespace

Result<std::string> edid_identity(std::span<const std::byte> edid) {
  const auto at = [&](std::size_t i) { return std::to_integer<std::uint32_t>(edid[i]); };
  if (edid.size() < kBlock_bytes) return fail(ErrorCode::ProtocolBroken, "screen: its EDID is shorter than a block");
  for (std::size_t i = 0; i < kHeader.size(); ++i)
    if (at(i) != kHeader[i]) return fail(ErrorCode::ProtocolBroken, "screen: its EDID does not begin as one");
  std::uint32_t sum = 0;
  for (std::size_t i = 0; i < kBlock_bytes; ++i) sum += at(i);
  if ((sum & 0xFF) != 0) return fail(ErrorCode::ProtocolBroken, "screen: the checksum of its EDID is wrong");

  const std::uint32_t maker = at(kMaker) << 8 | at(kMaker + 1);
  std::string name;
  for (const int shift : {10, 5, 0}) {
    const std::uint32_t letter = maker >> shift & 31;
    name += letter >= 1 && letter <= 26 ? static_cast<char>('A' + letter - 1) : '?';
  }
  std::string text = fmt::format("{} {:04X} {}", name, at(kProduct) | at(kProduct + 1) << 8,
                                 at(kSerial) | at(kSerial + 1) << 8 | at(kSerial + 2) << 16 | at(kSerial + 3) << 24);
  for (std::size_t d = kDescriptors; d + kDescriptor_bytes <= kBlock_bytes - 2; d += kDescriptor_bytes) {
    if (at(d) != 0 || at(d + 1) != 0 || at(d + 3) != kNameTag) continue;
    text += ' ';
    for (std::size_t i = d + kNameText; i < d + kDescriptor_bytes && at(i) != '\n'; ++i)
      text += at(i) >= 0x20 && at(i) < 0x7F ? static_cast<char>(at(i)) : '?';
  }
  return text.substr(0, text.find_last_not_of(' ') + 1);
}

}  // namespace telefab::fab
