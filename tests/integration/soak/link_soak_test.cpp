// SPDX-License-Identifier: GPL-3.0-or-later
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <telefab/service/client_session.hpp>
#include <telefab/test/loopback.hpp>

#include "fab_link.hpp"
#include "virtual_line.hpp"

namespace telefab::scan {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;
using test::Speaker;

/// A scan site's link, and a fab that a test plays, on one loop and a virtual clock.
class LinkSoak : public testing::Test {
 protected:
  void open_fab() {
    auto opened = net::Listener::open(
        loop_, {{"127.0.0.1", port_}, nullptr, {}},
        {[this](const net::ConnectionPtr& made) { on_connection(made); }, [](const std::string&, const Error&) {}});
    ASSERT_TRUE(opened) << opened.error().what;
    listener_ = std::move(*opened);
    port_ = listener_->port();
  }
  void on_connection(const net::ConnectionPtr& made) {
    ++connections_;
    handshake(
        loop_, made, {kProtocolVersion, Side::FabSite, "soak", {}, "automatic"},
        [this, weak = std::weak_ptr{made}](const Hello&) {
          fab_ = weak.lock();
          fab_->set_events({[this](const Frame& frame) { on_frame(frame); },
                            {},
                            [this](const Error& why) {
                              lost_.push_back(why.what);
                              fab_.reset();
                            }});
        },
        [](const Error&) {});
  }
  void on_frame(const Frame& frame) {
    const auto message = from_frame(frame).value();
    if (const auto* offer = std::get_if<Offer>(&message)) {
      ++offers_;
      (void)fab_->send(to_frame(OfferAccepted{offer->job, kept_, false}));
    }
    if (const auto* chunk = std::get_if<SendChunk>(&message)) {
      // What was kept before a cut is not sent again, and nothing is left out.
      EXPECT_EQ(chunk->sequence, kept_);
      kept_ = chunk->sequence + 1;
      (void)fab_->send(to_frame(ChunkStored{chunk->job, chunk->sequence}));
    }
  }
  void open_link() {
    FabLinkEvents events;
    events.changed = [this](bool is_up, const std::string&) { is_up_ = is_up; };
    events.acknowledged = [this](const std::string&, std::uint32_t layers, std::uint64_t) { layers_kept_ = layers; };
    events.kept = [](const std::string&) {};
    events.job_changed = [this](const Job& theirs) { printed_.push_back(theirs.counters.layers_printed); };
    events.refused = [](const std::string&, const Error& why) { ADD_FAILURE() << why.what; };
    link_ = std::make_unique<FabLink>(loop_, net::ConnectOptions{{"127.0.0.1", port_}, nullptr, {}, {}}, "", events);
    link_->start();
    pass_until([&] { return is_up_ && fab_; });
    const StackHeader header{"machine-a", 0.2, 0.1, 10'000, {{-1, -1}, {1, 1}}, kIdentity4, "statue.ply"};
    link_->add({"j1", "statue.ply", "machine-a", "{}", {}, header, 5, "ana", {}, {}}, spool_);
    pass_until([&] { return offers_ > 0; });
  }
  /// Resolving a name takes a thread of the system's, whose time is real.
  template <class Condition>
  void pass_until(Condition condition) {
    for (int tries = 0; tries < 5000 && !condition(); ++tries) {
      loop_.pass(clock_, milliseconds{1});
      ::usleep(200);
    }
    ASSERT_TRUE(condition());
  }
  void cut_layer() {
    const std::vector<std::byte> payload(500, static_cast<std::byte>(cut_));
    ASSERT_TRUE(spool_->with([&](ChunkSpool& spool) { return spool.append(LayerIndex{cut_}, 1, payload); }));
    ++cut_;
    link_->pump("j1");
  }

  test::ScratchFolder folder_;
  VirtualClock clock_{hours{24 * 365 * 50}};
  net::Loop loop_{clock_};
  std::uint16_t port_ = 0;
  std::unique_ptr<net::Listener> listener_;
  net::ConnectionPtr fab_;
  std::shared_ptr<SharedSpool> spool_ =
      std::make_shared<SharedSpool>(ChunkSpool::open(folder_.path() / "chunks").value());
  std::unique_ptr<FabLink> link_;
  bool is_up_ = false;
  int connections_ = 0, offers_ = 0;
  std::uint32_t kept_ = 0, layers_kept_ = 0, cut_ = 0;
  std::vector<std::uint32_t> printed_;
  std::vector<std::string> lost_;
};

TEST_F(LinkSoak, AnIdleLineBetweenTheSitesHoldsForADay) {
  open_fab();
  open_link();
  loop_.pass(clock_, hours{24});
  EXPECT_TRUE(is_up_);
  EXPECT_EQ(connections_, 1);
  EXPECT_THAT(lost_, testing::IsEmpty());
}

TEST_F(LinkSoak, LayersCutEveryMinuteForTenHoursGoOverOneLine) {
  open_fab();
  open_link();
  for (int minute = 0; minute < 600; ++minute) {
    cut_layer();
    loop_.pass(clock_, minutes{1});
  }
  EXPECT_EQ(layers_kept_, 600U);
  EXPECT_EQ(connections_, 1);
  EXPECT_THAT(lost_, testing::IsEmpty());
}

TEST_F(LinkSoak, AFabThatTellsOfALayerEveryTenSecondsForADayIsListenedToAllTheWhile) {
  open_fab();
  open_link();
  for (std::uint32_t layer = 1; layer <= 24 * 360; ++layer) {
    JobChanged change;
    change.job.id = "j1";
    change.job.name = "statue.ply";
    change.job.machine = "machine-a";
    change.job.state = JobState::Printing;
    change.job.counters.layers_printed = layer;
    ASSERT_TRUE(fab_ && fab_->send(to_frame(change))) << "lost at layer " << layer;
    loop_.pass(clock_, seconds{10});
  }
  EXPECT_EQ(printed_.size(), 24U * 360);
  EXPECT_EQ(connections_, 1);
}

TEST_F(LinkSoak, AFabThatIsAwayForHoursIsFoundAgainWithinSecondsAndGoesOnBehindItsLastChunk) {
  open_fab();
  open_link();
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 20; ++i) cut_layer();
    pass_until([&] { return layers_kept_ == cut_; });
    listener_.reset();
    fab_->close({});
    fab_.reset();
    pass_until([&] { return !is_up_; });
    for (int i = 0; i < 20; ++i) cut_layer();
    // Each try resolves the address in real time, so that the hours pass in steps.
    for (int minute = 0; minute < 240; ++minute) loop_.pass(clock_, minutes{1});
    EXPECT_FALSE(is_up_);
    open_fab();
    pass_until([&] {
      loop_.pass(clock_, milliseconds{20});
      return is_up_ && layers_kept_ == cut_;
    });
  }
  EXPECT_EQ(kept_, 120U);
}

/// A fab that says hello to whoever calls, and nothing ever after; its sockets stay open.
class HangingFab {
 public:
  HangingFab() : fd_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)} {
    sockaddr_in address = test::loopback(0);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(::listen(fd_, 8), 0);
    EXPECT_EQ(::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port = ntohs(address.sin_port);
  }
  ~HangingFab() {
    for (const int each : calls) ::close(each);
    ::close(fd_);
  }
  HangingFab(const HangingFab&) = delete;
  HangingFab& operator=(const HangingFab&) = delete;
  void accept() {
    const int call = ::accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC);
    if (call < 0) return;
    calls.push_back(call);
    const auto hello = to_bytes(to_frame(Hello{kProtocolVersion, Side::FabSite, "soak", {}, "automatic"})).value();
    EXPECT_EQ(::send(call, hello.data(), hello.size(), MSG_NOSIGNAL), static_cast<ssize_t>(hello.size()));
  }
  std::uint16_t port = 0;
  std::vector<int> calls;

 private:
  int fd_;
};

TEST_F(LinkSoak, AFabThatHangsIsGivenUpAfterAMinuteAndCalledAgain) {
  HangingFab hanging;
  std::vector<Nanoseconds> went_down;
  FabLinkEvents events;
  events.changed = [&](bool is_up, const std::string&) {
    if (is_up_ && !is_up) went_down.push_back(clock_.now());
    is_up_ = is_up;
  };
  link_ =
      std::make_unique<FabLink>(loop_, net::ConnectOptions{{"127.0.0.1", hanging.port}, nullptr, {}, {}}, "", events);
  link_->start();
  const Nanoseconds began = clock_.now();
  pass_until([&] {
    hanging.accept();
    return is_up_;
  });
  pass_until([&] {
    hanging.accept();
    loop_.pass(clock_, milliseconds{50});
    return hanging.calls.size() == 2 && is_up_;
  });
  ASSERT_EQ(went_down.size(), 1U);
  EXPECT_GE(went_down[0] - began, seconds{60});
  EXPECT_LE(went_down[0] - began, seconds{70});
}

}  // namespace
}  // namespace telefab::scan
