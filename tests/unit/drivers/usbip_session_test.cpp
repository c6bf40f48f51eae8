// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <telefab/fab/drivers/dlpc900_protocol.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/usbip_session.hpp>

namespace telefab::fab {
namespace {

using Bytes = std::vector<std::byte>;

void put32(Bytes& out, std::uint32_t v) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(std::byte(v >> shift & 0xFF));
}
std::uint32_t get32(const Bytes& in, std::size_t at) {
  std::uint32_t v = 0;
  for (std::size_t i = 0; i < 4; ++i) v = v << 8 | static_cast<std::uint32_t>(in[at + i]);
  return v;
}

Bytes operation(std::uint16_t code) {
  Bytes out;
  put32(out, 0x01110000u | code);
  put32(out, 0);
  return out;
}

Bytes submit(std::uint32_t sequence, std::uint32_t in, std::uint32_t endpoint, std::uint32_t length,
             std::array<std::uint8_t, 8> setup, const Bytes& data) {
  Bytes out;
  for (const std::uint32_t v : {1u, sequence, 0x10001u, in, endpoint, 0u, length, 0u, 0u, 0u}) put32(out, v);
  for (const std::uint8_t b : setup) out.push_back(std::byte{b});
  out.insert(out.end(), data.begin(), data.end());
  return out;
}

struct Connection {
  VirtualClock clock;
  Dlpc900Model projector{1, 6, clock, nullptr};
  GrblModel stage{25, clock, nullptr};
  std::unique_ptr<UsbPeer> projector_peer = make_projector_peer(projector, "P1");
  std::unique_ptr<UsbPeer> stage_peer = make_stage_peer(stage, "S1");
  UsbIpSession session{{projector_peer.get(), stage_peer.get()}};

  Bytes ask(const Bytes& bytes) {
    // One byte at a time: no answer may depend on how the network cuts the stream.
    for (const std::byte b : bytes) EXPECT_TRUE(session.feed({&b, 1}));
    return session.take();
  }
  void import_device(const char* id) {
    Bytes request = operation(0x8003);
    for (std::size_t i = 0; i < 32; ++i) request.push_back(i < std::strlen(id) ? std::byte(id[i]) : std::byte{0});
    const Bytes reply = ask(request);
    ASSERT_EQ(reply.size(), 8u + 312u);
    ASSERT_EQ(get32(reply, 4), 0u);
  }
};

TEST(UsbIpSession, ListsBothDevicesWithTheirInterfaces) {
  Connection c;
  const Bytes reply = c.ask(operation(0x8005));
  ASSERT_EQ(reply.size(), 12u + 312u + 4u + 312u + 8u);
  EXPECT_EQ(get32(reply, 0), 0x01110005u);
  EXPECT_EQ(get32(reply, 8), 2u);
  EXPECT_EQ(get32(reply, 12 + 256 + 32 + 12), 0x0451C900u) << "vendor and product, big endian";
  EXPECT_EQ(get32(reply, 12 + 312), 0x03000000u) << "a HID interface";
}

TEST(UsbIpSession, RefusesABusIdItDoesNotHave) {
  Connection c;
  Bytes request = operation(0x8003);
  request.resize(8 + 32, std::byte{'9'});
  const Bytes reply = c.ask(request);
  EXPECT_EQ(reply.size(), 8u);
  EXPECT_EQ(get32(reply, 4), 1u);
}

TEST(UsbIpSession, CarriesADescriptorACommandAndItsReply) {
  Connection c;
  c.import_device("1-1");
  const Bytes descriptor = c.ask(submit(1, 1, 0, 18, {0x80, 6, 0, 1, 0, 0, 18, 0}, {}));
  ASSERT_EQ(descriptor.size(), 48u + 18u);
  EXPECT_EQ(get32(descriptor, 20), 0u);
  EXPECT_EQ(descriptor[48 + 8], std::byte{0x51});

  const auto command = dlpc900::frame(dlpc900::kRead, 9, dlpc900::Command::DmdType, {});
  EXPECT_EQ(c.ask(submit(2, 0, 1, 64, {}, command)).size(), 48u);
  const Bytes reply = c.ask(submit(3, 1, 1, 64, {}, {}));
  ASSERT_EQ(reply.size(), 48u + 64u);
  EXPECT_EQ(get32(reply, 4), 3u);
  EXPECT_EQ(reply[48 + 1], std::byte{9});
  EXPECT_EQ(reply[48 + 4], std::byte{1});
}

TEST(UsbIpSession, KeepsAnUnansweredTransferUntilThereIsAnAnswerOrItIsUnlinked) {
  Connection c;
  c.import_device("1-1");
  EXPECT_TRUE(c.ask(submit(5, 1, 1, 64, {}, {})).empty());
  Bytes unlink;
  for (const std::uint32_t v : {2u, 6u, 0x10001u, 0u, 0u, 5u}) put32(unlink, v);
  unlink.resize(48);
  const Bytes reply = c.ask(unlink);
  ASSERT_EQ(reply.size(), 48u);
  EXPECT_EQ(get32(reply, 0), 4u);
  EXPECT_EQ(static_cast<std::int32_t>(get32(reply, 20)), -104);
  EXPECT_TRUE(c.ask(submit(7, 1, 1, 64, {}, {})).empty());
  EXPECT_EQ(c.ask(submit(8, 0, 1, 64, {}, dlpc900::frame(dlpc900::kRead, 1, dlpc900::Command::MainStatus, {}))).size(),
            48u);
  c.session.advance();
  EXPECT_EQ(c.session.take().size(), 48u + 64u);
}

TEST(UsbIpSession, SpeaksForTheStageThroughItsBulkPair) {
  Connection c;
  c.import_device("1-2");
  EXPECT_EQ(c.ask(submit(1, 0, 0, 0, {0x21, 0x22, 3, 0, 0, 0, 0, 0}, {})).size(), 48u);
  EXPECT_TRUE(c.ask(submit(2, 1, 2, 64, {}, {})).empty());
  c.clock.advance(std::chrono::seconds{1});
  c.session.advance();
  const Bytes banner = c.session.take();
  ASSERT_GT(banner.size(), 48u);
  const std::string text{reinterpret_cast<const char*>(banner.data()) + 48, banner.size() - 48};
  EXPECT_THAT(text, testing::HasSubstr("Grbl 1.1"));
}

TEST(UsbIpSession, EndsWithAClientThatBreaksTheProtocol) {
  Connection c;
  const Bytes noise(64, std::byte{0xEE});
  EXPECT_EQ(c.session.feed(noise).error().code, ErrorCode::ProtocolBroken);
  Connection d;
  d.import_device("1-1");
  EXPECT_EQ(d.session.feed(submit(1, 0, 1, 1u << 30, {}, {})).error().code, ErrorCode::ProtocolBroken);
}

}  // namespace
}  // namespace telefab::fab
