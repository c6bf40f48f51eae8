// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/fab/screen/edid.hpp>
#include <vector>

namespace telefab::fab {
namespace {

/// A base block with a maker, a product, a serial number and a name; its checksum is right.
std::vector<std::byte> block(std::string_view name) {
  std::vector<std::byte> e(128);
  for (std::size_t i = 1; i < 7; ++i) e[i] = std::byte{0xFF};
  const unsigned maker = ('R' - 64u) << 10 | ('H' - 64u) << 5 | ('T' - 64u);
  e[8] = static_cast<std::byte>(maker >> 8);
  e[9] = static_cast<std::byte>(maker & 0xFF);
  e[10] = std::byte{0x34};
  e[11] = std::byte{0x12};
  e[12] = std::byte{7};
  if (!name.empty()) {
    e[72 + 3] = std::byte{0xFC};
    for (std::size_t i = 0; i < 13; ++i)
      e[72 + 5 + i] = static_cast<std::byte>(i < name.size() ? name[i] : i == name.size() ? '\n' : ' ');
  }
  unsigned sum = 0;
  for (const std::byte b : e) sum += std::to_integer<unsigned>(b);
  e[127] = static_cast<std::byte>(256 - sum % 256);
  return e;
}

TEST(Edid, IsMakerProductSerialNumberAndName) {
  EXPECT_EQ(edid_identity(block("QEMU Monitor")).value(), "RHT 1234 7 QEMU Monitor");
  EXPECT_EQ(edid_identity(block("")).value(), "RHT 1234 7");
  EXPECT_EQ(edid_identity(block("thirteen char")).value(), "RHT 1234 7 thirteen char");
  EXPECT_EQ(edid_identity(block("a\x01\xff")).value(), "RHT 1234 7 a??");
}

TEST(Edid, IsRefusedWhereAnyByteIsAnotherOrTheEndIsMissing) {
  const auto good = block("QEMU Monitor");
  for (std::size_t i = 0; i < good.size(); ++i) {
    auto bad = good;
    bad[i] ^= std::byte{0x10};
    EXPECT_FALSE(edid_identity(bad)) << i;
    EXPECT_FALSE(edid_identity(std::span{good}.first(i))) << i;
  }
}

}  // namespace
}  // namespace telefab::fab
