// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <random>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/test/loopback.hpp>
#include <telefab/test/two_sites.hpp>
#include <telefab/wire/message.hpp>

namespace telefab::test {
namespace {

using testing::HasSubstr;

/// Any peer with a socket.
class RawPeer {
 public:
  explicit RawPeer(const std::string& port) : fd_{::socket(AF_INET, SOCK_STREAM, 0)} {
    const timeval limit{20, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    const sockaddr_in address = loopback(static_cast<std::uint16_t>(std::stoi(port)));
    connected_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  ~RawPeer() { ::close(fd_); }
  RawPeer(const RawPeer&) = delete;
  RawPeer& operator=(const RawPeer&) = delete;
  [[nodiscard]] bool connected() const { return connected_; }
  void send(std::span<const std::byte> bytes) const { (void)::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  void send(const Message& message) const { send(to_bytes(to_frame(message)).value()); }
  void end() const { ::shutdown(fd_, SHUT_WR); }
  /// Everything the site says until it closes; the named reason is in the clear text of its fault.
  [[nodiscard]] std::string receive_all() const {
    std::string received;
    std::array<char, 4096> buffer{};
    ssize_t got = 0;
    while ((got = ::recv(fd_, buffer.data(), buffer.size(), 0)) > 0)
      received.append(buffer.data(), static_cast<std::size_t>(got));
    return received;
  }

 private:
  int fd_;
  bool connected_ = false;
};

class Hostile : public TwoSites {
 protected:
  Hostile() { start_both(); }
  /// Both daemons answer and print as if nothing had been.
  void expect_unharmed() {
    const Outcome done = telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--watch"});
    EXPECT_EQ(done.code, 0) << done.errors;
  }
  [[nodiscard]] std::vector<std::string> ports() const { return {scan_port(), fab_port()}; }
};

TEST_F(Hostile, BytesLeaveBothDaemonsUnharmed) {
  std::mt19937 random{5};
  for (const std::string& port : ports())
    for (int i = 0; i < 40; ++i) {
      const RawPeer peer{port};
      ASSERT_TRUE(peer.connected());
      std::vector<std::byte> noise(1 + random() % 3000);
      for (std::byte& byte : noise) byte = static_cast<std::byte>(random());
      if (i % 2 == 0) {
        noise[0] = std::byte{'T'};
        if (noise.size() > 1) noise[1] = std::byte{'F'};
      }
      peer.send(noise);
      peer.end();
      (void)peer.receive_all();
    }
  expect_unharmed();
}

struct Rudeness {
  const char* reason;
  std::vector<Message> messages;
};

TEST_F(Hostile, ConversationsEndWithANamedReason) {
  const Hello client{kProtocolVersion, Side::Client, "rude", {}, {}};
  const Hello scan{kProtocolVersion, Side::ScanSite, "rude", {}, {}};
  const Rudeness to_both[]{
      {"handshake", {AskJobs{RequestId{1}, {}, 10, false}}},
      {"protocol-version", {Hello{99, Side::Client, "rude", {}, {}}}},
      {"protocol-version", {Hello{kProtocolVersion - 1, Side::ScanSite, "the release before", {}, {}}}},
      {"handshake", {Hello{kProtocolVersion, Side::FabSite, "rude", {}, {}}}},
      {"message-order", {client, StackStored{"j1"}}},
      {"message-field", {client, AskFile{RequestId{1}, "j1", "../../jobs.sqlite"}}},
      {"no job", {client, AskFile{RequestId{1}, "j1", "plan.json"}, StackStored{"j1"}}},
  };
  for (const std::string& port : ports())
    for (const Rudeness& each : to_both) {
      const RawPeer peer{port};
      for (const Message& message : each.messages) peer.send(message);
      EXPECT_THAT(peer.receive_all(), HasSubstr(each.reason));
    }
  const RawPeer peer{fab_port()};
  peer.send(scan);
  peer.send(Message{UploadBlock{RequestId{1}, 0, std::vector<std::byte>(10)}});
  EXPECT_THAT(peer.receive_all(), HasSubstr("message-order"));
  expect_unharmed();
}

TEST_F(Hostile, AJobOfTheSameIdIsRefusedAsReplayed) {
  const std::string job = submit_torus();
  EXPECT_EQ(telefab({"watch", job}).code, 0);
  StackHeader header;
  header.machine = "toy";
  header.layer_thickness_mm = 0.2;
  header.pixel_pitch_mm = 0.1;
  header.layer_count = 7;
  header.bounds = {{1, 1}, {2, 2}};
  const RawPeer peer{fab_port()};
  peer.send(Message{Hello{kProtocolVersion, Side::ScanSite, "rude", {}, {}}});
  peer.send(Message{
      Offer{job, "other.ply", "toy", "{}", {}, header, static_cast<std::uint32_t>(Coding::Exact), "mallory", {}, {}}});
  peer.send(Message{Submit{RequestId{2}, "a", "toy", "{}", 1, {}}});
  EXPECT_THAT(peer.receive_all(), HasSubstr("replayed-job"));
}

TEST_F(Hostile, FilesOfOtherPlacesAreNotGivenOut) {
  const std::string job = submit_torus();
  EXPECT_EQ(telefab({"watch", job}).code, 0);
  const RawPeer peer{fab_port()};
  peer.send(Message{Hello{kProtocolVersion, Side::ScanSite, "rude", {}, {}}});
  // A plain file name, in the job's folder, and not for others.
  peer.send(Message{AskFile{RequestId{1}, job, "journal"}});
  peer.send(Message{Submit{RequestId{2}, "a", "toy", "{}", 1, {}}});
  EXPECT_THAT(peer.receive_all(), HasSubstr("has no file journal"));
}

}  // namespace
}  // namespace telefab::test
