// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/drivers/dlpc900_image.hpp>
#include <telefab/fab/drivers/dlpc900_protocol.hpp>

namespace telefab::fab::dlpc900 {
namespace {

std::string hex(std::span<const std::byte> bytes, std::size_t most) {
  static constexpr std::string_view digits = "0123456789ABCDEF";
  std::string text;
  for (const std::byte b : bytes.first(std::min(most, bytes.size()))) {
    text += digits[static_cast<unsigned>(b) >> 4];
    text += digits[static_cast<unsigned>(b) & 15];
    text += ' ';
  }
  if (!text.empty()) text.pop_back();
  return text;
}

std::string count_bytes(std::uint32_t n) {
  std::vector<std::byte> out;
  append_count(out, n);
  return hex(out, 8);
}

TEST(Dlpc900Frame, HasTheGuidesReadHeader) {
  const auto f = frame(kRead, 0x11, Command::MainStatus, {});
  EXPECT_EQ(hex(f, 7), "C0 11 02 00 0C 1A 00");
  EXPECT_EQ(f.size(), 64u);
}

TEST(Dlpc900Frame, HasTheGuidesWriteHeaderAndData) {
  const std::byte data[] = {std::byte{0x02}};
  EXPECT_EQ(hex(frame(kWriteReplied, 0x12, Command::PatternStartStop, data), 8), "40 12 03 00 24 1A 02 00");
}

TEST(Dlpc900Frame, ContinuesInWholeReportsWithoutASecondHeader) {
  const std::vector<std::byte> data(506, std::byte{0xAB});
  const auto f = frame(kWrite, 0, Command::ImageBlock, data);
  EXPECT_EQ(f.size(), 512u);
  EXPECT_EQ(hex(std::span{f}.subspan(64), 3), "AB AB AB");
  EXPECT_EQ(hex(f, 6), "00 00 FC 01 2B 1A");
}

TEST(Dlpc900Pattern, IsTheTwelveBytesOfTheExample) {
  EXPECT_EQ(hex(pattern_definition(2'000'000, Led::Blue), 12), "00 00 80 84 1E 4E 00 00 00 01 00 00");
}

TEST(Dlpc900Count, IsOneByteBelow128AndTwoAbove) {
  EXPECT_EQ(count_bytes(0x1234), "B4 24");
  EXPECT_EQ(count_bytes(513), "81 04");
  EXPECT_EQ(count_bytes(130), "82 01");
  EXPECT_EQ(count_bytes(127), "7F");
  EXPECT_EQ(count_bytes(128), "80 01");
  EXPECT_EQ(count_bytes(32767), "FF FF");
}

TEST(Dlpc900Image, CodesAFlatMaskAsOneRunAndCopies) {
  const Mask m{{4, 2}, std::vector<std::uint8_t>(8, 0x7F)};
  const auto image = encode_dlpc900_image(m.view());
  EXPECT_EQ(hex(image, 48),
            "53 70 6C 64 04 00 02 00 0C 00 00 00 FF FF FF FF FF FF FF FF 00 00 00 00 01 02 01 00 00 01 "
            "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00");
  EXPECT_EQ(hex(std::span{image}.subspan(48), 64), "04 7F 7F 7F 00 01 04 00 01 00 00 00");
}

TEST(Dlpc900Image, WritesASingleOddPixelAsARunOfOne) {
  const Mask m{{4, 1}, {9, 0, 0, 0}};
  const auto image = encode_dlpc900_image(m.view());
  EXPECT_EQ(hex(std::span{image}.subspan(48), 64), "01 09 09 09 03 00 00 00 00 01 00 00");
}

TEST(Dlpc900Reply, IsRefusedWhenShorterThanItSays) {
  const std::byte cut[] = {std::byte{0xC0}, std::byte{1}, std::byte{9}, std::byte{0}, std::byte{1}};
  EXPECT_EQ(parse_reply(cut).error().code, ErrorCode::ProtocolBroken);
  EXPECT_EQ(parse_reply({}).error().code, ErrorCode::ProtocolBroken);
}

TEST(Dlpc900Firmware, ChoosesTheNewestRowNotNewerThanItself) {
  EXPECT_FALSE(firmware_facts(4, 0).park_after_mode_change);
  EXPECT_TRUE(firmware_facts(4, 1).park_after_mode_change);
  EXPECT_TRUE(firmware_facts(5, 0).park_after_mode_change);
  EXPECT_FALSE(firmware_facts(6, 0).park_after_mode_change);
  EXPECT_TRUE(firmware_facts(6, 0).configuration_before_images);
}

}  // namespace
}  // namespace telefab::fab::dlpc900
