// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <functional>
#include <optional>
#include <telefab/net/listener.hpp>
#include <telefab/test/loopback.hpp>
#include <telefab/test/no_descriptors.hpp>
#include <thread>

namespace telefab::net {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

constexpr Nanoseconds kPatience = std::chrono::seconds{20};
constexpr Nanoseconds kNever = std::chrono::hours{1};

/// A peer that only does what it is told.
class Socket {
 public:
  explicit Socket(std::uint16_t port) : fd_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)} {
    const timeval limit{20, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    const sockaddr_in address = test::loopback(port);
    EXPECT_EQ(::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~Socket() { ::close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  void send(std::span<const std::byte> bytes) const {
    EXPECT_EQ(::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }
  void end() const { ::shutdown(fd_, SHUT_WR); }
  [[nodiscard]] std::size_t bytes_waiting() const {
    int bytes = 0;
    EXPECT_EQ(::ioctl(fd_, FIONREAD, &bytes), 0);
    return static_cast<std::size_t>(bytes);
  }
  /// Bytes until the other side closes; those of pings are not counted.
  [[nodiscard]] std::size_t receive_all() const {
    std::array<std::byte, 4096> buffer{};
    FrameReader reader;
    std::size_t received = 0;
    for (ssize_t got = 0; (got = ::recv(fd_, buffer.data(), buffer.size(), 0)) > 0;) {
      reader.feed(std::span{buffer}.first(static_cast<std::size_t>(got)));
      for (auto frame = reader.take(); frame && *frame; frame = reader.take())
        if ((*frame)->type != FrameType::Ping) received += (*frame)->body.size();
    }
    return received;
  }

 private:
  int fd_;
};

/// A listener whose peers have these limits; what ends the first connection is kept.
class ConnectionTimes : public testing::Test {
 protected:
  static ConnectionLimits patient() {
    ConnectionLimits limits;
    limits.handshake_within = limits.frame_within = limits.idle_after = limits.write_within = kNever;
    return limits;
  }
  void listen(const ConnectionLimits& limits, bool answers_hello = true) {
    auto opened = Listener::open(loop_, {{"127.0.0.1", 0}, nullptr, limits},
                                 {[this, answers_hello](ConnectionPtr made) {
                                    connection_ = std::move(made);
                                    connection_->start({[this](Frame frame) { on_frame(frame); },
                                                        {},
                                                        [this](const Error& error) {
                                                          why_ = error;
                                                          loop_.stop();
                                                        }});
                                    if (answers_hello) connection_->set_ready();
                                    if (!to_send_.body.empty()) (void)connection_->send(to_send_);
                                  },
                                  [](const std::string&, const Error&) {}});
    ASSERT_TRUE(opened) << opened.error().what;
    listener_ = std::move(*opened);
  }
  void on_frame(const Frame& frame) {
    ++frames_;
    if (frame.type == FrameType::Command && connection_) {
      connection_->close(Frame{FrameType::Fault, std::vector<std::byte>(last_words_)});
      loop_.stop();
    }
  }
  /// The name of what ended the connection.
  std::string ended() {
    EXPECT_TRUE(loop_.run_for(kPatience)) << "nothing ended the connection";
    return why_ ? why_->what : "";
  }

  Loop loop_;
  std::unique_ptr<Listener> listener_;
  ConnectionPtr connection_;
  std::optional<Error> why_;
  Frame to_send_;
  std::size_t last_words_ = 100;
  int frames_ = 0;
};

std::vector<std::byte> a_frame(FrameType type, std::size_t bytes) {
  return to_bytes({type, std::vector<std::byte>(bytes)}).value();
}

TEST_F(ConnectionTimes, APeerThatSendsNothingIsDroppedAtTheHandshake) {
  ConnectionLimits limits = patient();
  limits.handshake_within = milliseconds{50};
  listen(limits, false);
  const Socket silent{listener_->port()};
  EXPECT_THAT(ended(), HasSubstr("handshake-time"));
}

TEST_F(ConnectionTimes, AnIdlePeerBeforeItsHandshakeGivesWayToANewerOne) {
  ConnectionLimits limits = patient();
  listen(limits, false);
  std::vector<std::unique_ptr<Socket>> silent;
  for (int i = 0; i < 33; ++i) silent.push_back(std::make_unique<Socket>(listener_->port()));
  EXPECT_THAT(ended(), HasSubstr("handshake-place"));
}

TEST_F(ConnectionTimes, AListenerWithoutDescriptorsWaitsForThemWithoutUsingTheProcessor) {
  listen(patient(), false);
  std::optional<test::NoDescriptors> none{1};
  const Socket peer{listener_->port()};
  const double before = test::processor_seconds();
  (void)loop_.run_for(milliseconds{400});
  EXPECT_LT(test::processor_seconds() - before, 0.1);
  EXPECT_FALSE(connection_);
  none.reset();
  for (int tries = 0; tries < 100 && !connection_; ++tries) (void)loop_.run_for(milliseconds{20});
  EXPECT_TRUE(connection_) << "who waited meanwhile comes in";
}

TEST_F(ConnectionTimes, AFrameThatNeverEndsIsDroppedThoughBytesKeepComing) {
  ConnectionLimits limits = patient();
  limits.frame_within = milliseconds{100};
  listen(limits);
  const Socket slow{listener_->port()};
  const auto frame = a_frame(FrameType::Jobs, 100'000);
  // A byte now and then, for as long as it takes: each is news, none is a frame.
  std::size_t next = 0;
  const std::function<void()> drip = [&] {
    if (next < 5000) slow.send(std::span{frame}.subspan(next++, 1));
    loop_.after(milliseconds{5}, drip);
  };
  drip();
  EXPECT_THAT(ended(), HasSubstr("frame-time"));
  EXPECT_EQ(frames_, 0);
  EXPECT_LT(next, 5000U);
}

TEST_F(ConnectionTimes, AFrameHasItsTimeFromItsFirstByteOnNotFromTheSilenceBefore) {
  ConnectionLimits limits = patient();
  limits.frame_within = milliseconds{400};
  listen(limits);
  const Socket peer{listener_->port()};
  const auto frame = a_frame(FrameType::Command, 1000);
  loop_.after(milliseconds{600}, [&] { peer.send(std::span{frame}.first(500)); });
  loop_.after(milliseconds{700}, [&] { peer.send(std::span{frame}.subspan(500)); });
  EXPECT_EQ(ended(), "");
  EXPECT_EQ(frames_, 1);
}

TEST_F(ConnectionTimes, ASilentPeerIsDroppedAfterPingsWentUnanswered) {
  ConnectionLimits limits = patient();
  limits.idle_after = milliseconds{90};
  listen(limits);
  const Socket dead{listener_->port()};
  EXPECT_THAT(ended(), HasSubstr("idle-time"));
}

TEST_F(ConnectionTimes, WhoOnlyListensSendsPingsHoweverMuchItHears) {
  ConnectionLimits limits = patient();
  limits.idle_after = milliseconds{90};
  listen(limits);
  const Socket talker{listener_->port()};
  const auto frame = a_frame(FrameType::Jobs, 100);
  // Ten times as long as the other side would wait for a sign of life.
  int sent = 0;
  const std::function<void()> talk = [&] {
    talker.send(frame);
    if (++sent == 90) return loop_.stop();
    loop_.after(milliseconds{10}, talk);
  };
  talk();
  EXPECT_EQ(ended(), "");
  EXPECT_GT(frames_, 50);
  EXPECT_GT(talker.bytes_waiting() / to_bytes({FrameType::Ping, {}}).value().size(), 8U);
}

TEST_F(ConnectionTimes, APeerThatTakesNoBytesIsDropped) {
  ConnectionLimits limits = patient();
  limits.write_within = milliseconds{100};
  to_send_ = {FrameType::FileBlock, std::vector<std::byte>(4U << 20U)};
  listen(limits);
  const Socket deaf{listener_->port()};
  // More than the system's buffers hold.
  loop_.after(milliseconds{1}, [&] {
    for (int i = 0; i < 3 && connection_; ++i) (void)connection_->send(to_send_);
  });
  EXPECT_THAT(ended(), HasSubstr("write-time"));
}

TEST_F(ConnectionTimes, LastWordsReachAPeerThatHasEndedItsOwnSide) {
  listen(patient());
  last_words_ = 2U << 20U;  // not all taken at once
  const Socket peer{listener_->port()};
  peer.send(a_frame(FrameType::Command, 10));
  peer.end();
  std::size_t received = 0;
  std::jthread receiving{[&] { received = peer.receive_all(); }};
  EXPECT_TRUE(loop_.run_for(kPatience));
  connection_.reset();
  (void)loop_.run_for(milliseconds{500});
  receiving.join();
  EXPECT_EQ(received, last_words_);
}

TEST_F(ConnectionTimes, ARefusedPeerThatHasGoneDoesNotKeepItsPlace) {
  listen(patient());
  {
    const Socket peer{listener_->port()};
    auto damaged = a_frame(FrameType::Jobs, 20'000);
    damaged[300] ^= std::byte{1};
    peer.send(damaged);
    peer.send(a_frame(FrameType::Jobs, 20'000));
    EXPECT_THAT(ended(), HasSubstr("frame-check"));
  }
  EXPECT_EQ(frames_, 0);
}

/// Holds its connection, whose events hold it again: as the sessions of the daemons do.
struct Session {
  ConnectionPtr connection;
};

// At an orderly end of a daemon such a pair once stayed for good, and with it the files it was receiving.
TEST(ListenerEnd, ClosesWhatCameInByItAndFreesWhoHeldIt) {
  std::weak_ptr<Session> held;
  std::weak_ptr<Connection> connection;
  int closed = 0;
  std::optional<Socket> peer;
  {
    Loop loop;
    const auto listener =
        Listener::open(loop, {{"127.0.0.1", 0}, nullptr, {}},
                       {[&](const ConnectionPtr& made) {
                          const auto session = std::make_shared<Session>(Session{made});
                          held = session;
                          connection = made;
                          made->start({[session](const Frame&) {}, {}, [session, &closed](const Error&) { ++closed; }});
                          made->set_ready();
                          loop.stop();
                        },
                        [](const std::string&, const Error&) {}})
            .value();
    peer.emplace(listener->port());
    ASSERT_TRUE(loop.run_for(kPatience));
    ASSERT_FALSE(held.expired());
  }
  EXPECT_TRUE(held.expired());
  EXPECT_TRUE(connection.expired());
  EXPECT_EQ(closed, 0) << "whoever would hear of it may be gone already";
  EXPECT_EQ(peer->receive_all(), 0U) << "the peer sees the end";
}

}  // namespace
}  // namespace telefab::net
