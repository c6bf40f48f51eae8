// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <telefab/service/client_session.hpp>
#include <telefab/test/loopback.hpp>

#include "virtual_line.hpp"

namespace telefab::test {
namespace {

using std::chrono::hours;
using std::chrono::minutes;
using std::chrono::seconds;
using testing::HasSubstr;

/// A site that keeps what it is sent and does nothing else.
class IdleService final : public JobService {
 public:
  IdleService(JobStore& store, std::filesystem::path incoming) : store_{store}, incoming_{std::move(incoming)} {}
  JobStore& store() override { return store_; }
  void machines(std::function<void(Machines)> done) override { done({}); }
  Result<void> may_submit(const Submit&) override { return {}; }
  void expect_upload(const std::filesystem::path&, std::uint64_t) override {}
  std::filesystem::path incoming() override { return incoming_; }
  Result<Job> submit(const Submit& submit, const std::filesystem::path&, std::string_view owner) override {
    return store_.create({{}, submit.name, submit.machine, "{}", std::string{owner}});
  }
  void command(const Command& command, std::function<void(Result<Job>)> done) override {
    done(store_.find(command.job));
  }
  void files(const std::string&, std::function<void(Result<std::vector<FileEntry>>)> done) override { done({}); }
  void file(const std::string&, const std::string&, std::function<void(Result<std::filesystem::path>)> done) override {
    done(fail(ErrorCode::NotFound, "no file"));
  }
  void note(std::string_view, std::string_view what) override { notes.emplace_back(what); }
  std::vector<std::string> notes;

 private:
  JobStore& store_;
  std::filesystem::path incoming_;
};

/// A site and its clients on one loop and a virtual clock.
class ClientSoak : public testing::Test {
 protected:
  void SetUp() override {
    listener_ = net::Listener::open(loop_, {{"127.0.0.1", 0}, nullptr, {}},
                                    {[this](const net::ConnectionPtr& made) { on_connection(made); },
                                     [](const std::string&, const Error&) {}})
                    .value();
    job_ = store_->create({{}, "statue.ply", "machine-a", "{}", "ana"}).value().id;
  }
  void on_connection(const net::ConnectionPtr& made) {
    at_site_ = made;
    handshake(
        loop_, made, {kProtocolVersion, Side::ScanSite, "soak", {}, {}},
        [this, weak = std::weak_ptr{made}](const Hello&) { serve_client(loop_, weak.lock(), service_, {}); },
        [](const Error&) {});
  }
  /// As the program `telefab` connects.
  std::unique_ptr<Speaker> client() {
    auto client = std::make_unique<Speaker>();
    net::ConnectOptions options{{"127.0.0.1", listener_->port()}, nullptr, {}, {}};
    options.limits.idle_after = seconds{120};
    net::connect_to(loop_, options, [&](Result<net::ConnectionPtr> made) {
      client->connection = made.value();
      client->start();
      EXPECT_TRUE(client->send(Hello{kProtocolVersion, Side::Client, "soak", {}, {}}));
      client->connection->set_ready();
    });
    pass_until([&] { return client->last<Hello>() != nullptr; });
    return client;
  }
  std::unique_ptr<Speaker> watcher() {
    auto made = client();
    EXPECT_TRUE(made->send(AskJobs{RequestId{1}, job_, 1, true}));
    return made;
  }
  /// Resolving a name takes a thread of the system's, whose time is real.
  template <class Condition>
  void pass_until(Condition condition) {
    for (int tries = 0; tries < 5000 && !condition(); ++tries) {
      loop_.pass(clock_, std::chrono::milliseconds{1});
      ::usleep(200);
    }
    ASSERT_TRUE(condition());
  }
  void print_layer(std::uint32_t layer) {
    JobCounters counters;
    counters.print_layers = 10'000;
    counters.layers_printed = layer;
    ASSERT_TRUE(store_->set_counters(job_, counters));
  }

  ScratchFolder folder_;
  VirtualClock clock_{hours{24 * 365 * 50}};
  net::Loop loop_{clock_};
  std::unique_ptr<JobStore> store_ = JobStore::open(folder_.path() / "jobs.sqlite", clock_).value();
  IdleService service_{*store_, folder_.path()};
  std::unique_ptr<net::Listener> listener_;
  std::weak_ptr<net::Connection> at_site_;
  std::string job_;
};

/// A peer that speaks the wire by hand and then does only what a test says.
class RawPeer {
 public:
  explicit RawPeer(std::uint16_t port) : fd_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)} {
    const int small = 4096;  // what it does not read is soon felt
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    const sockaddr_in address = loopback(port);
    EXPECT_EQ(::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    // Else a small frame waits for an acknowledgement of the one before, in real time.
    const int yes = 1;
    ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  }
  ~RawPeer() { ::close(fd_); }
  RawPeer(const RawPeer&) = delete;
  RawPeer& operator=(const RawPeer&) = delete;
  bool send(const Frame& frame) const {
    const auto bytes = to_bytes(frame).value();
    return ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }

 private:
  int fd_;
};

TEST_F(ClientSoak, AnOperatorWatchesAJobThatDoesNothingForEightHours) {
  const auto watcher = ClientSoak::watcher();
  loop_.pass(clock_, hours{8});
  EXPECT_FALSE(watcher->lost) << watcher->lost->what;
  print_layer(1);
  loop_.pass(clock_, seconds{1});
  ASSERT_NE(watcher->last<Jobs>(), nullptr);
  EXPECT_EQ(watcher->last<Jobs>()->jobs.at(0).counters.layers_printed, 1U);
}

TEST_F(ClientSoak, AnOperatorWatchesLayerAfterLayerForSixHoursAndSaysNothingHerself) {
  const auto watcher = ClientSoak::watcher();
  loop_.pass(clock_, seconds{1});
  // A layer every ten seconds: the listener never has a silence in which its side would ping for silence alone.
  for (std::uint32_t layer = 1; layer <= 6 * 360; ++layer) {
    print_layer(layer);
    loop_.pass(clock_, seconds{10});
    ASSERT_FALSE(watcher->lost) << "at layer " << layer << ": " << watcher->lost->what;
  }
  EXPECT_EQ(watcher->received.size(), 2U + 6 * 360) << "hello, the job, and every layer";
}

TEST_F(ClientSoak, AScanIsSubmittedByHalfAMegabyteAMinuteForHoursAndWatchedOnTheSameLine) {
  const auto submitter = client();
  constexpr std::uint64_t kBlock = 512U << 10U, kBlocks = 180;
  const std::vector<std::byte> block(kBlock, std::byte{7});
  Hasher hasher;
  for (std::uint64_t i = 0; i < kBlocks; ++i) hasher.feed(block);
  ASSERT_TRUE(submitter->send(Submit{RequestId{1}, "slow.ply", "machine-a", "{}", kBlock * kBlocks, hasher.digest()}));
  for (std::uint64_t i = 0; i < kBlocks; ++i) {
    loop_.pass(clock_, minutes{1});
    ASSERT_TRUE(submitter->send(UploadBlock{RequestId{1}, i * kBlock, block})) << i;
    ASSERT_FALSE(submitter->lost) << "at block " << i << ": " << submitter->lost->what;
  }
  pass_until([&] { return submitter->last<Jobs>() != nullptr; });
  job_ = submitter->last<Jobs>()->jobs.at(0).id;
  ASSERT_TRUE(submitter->send(AskJobs{RequestId{2}, job_, 1, true}));
  loop_.pass(clock_, hours{2});
  EXPECT_FALSE(submitter->lost) << submitter->lost->what;
  print_layer(5);
  loop_.pass(clock_, seconds{1});
  EXPECT_EQ(submitter->last<Jobs>()->jobs.at(0).counters.layers_printed, 5U);
}

TEST_F(ClientSoak, AHalfOpenWatcherIsLetGoAfterAMinuteAndNotEarlier) {
  const RawPeer gone{listener_->port()};
  ASSERT_TRUE(gone.send(to_frame(Hello{kProtocolVersion, Side::Client, "soak", {}, {}})));
  ASSERT_TRUE(gone.send(to_frame(AskJobs{RequestId{1}, job_, 1, true})));
  pass_until([&] { return !at_site_.expired() && at_site_.lock()->is_ready(); });
  const auto watcher = ClientSoak::watcher();  // beside it one that lives
  std::weak_ptr<net::Connection> living = at_site_;
  loop_.pass(clock_, seconds{58});
  EXPECT_TRUE(gone.send(Frame{FrameType::Pong, {}})) << "the line is there";
  loop_.pass(clock_, seconds{58});
  EXPECT_TRUE(gone.send(Frame{FrameType::Pong, {}})) << "and a sign of life keeps it";
  loop_.pass(clock_, seconds{65});
  (void)gone.send(Frame{FrameType::Pong, {}});
  loop_.pass(clock_, seconds{1});
  EXPECT_FALSE(gone.send(Frame{FrameType::Pong, {}}));
  loop_.pass(clock_, hours{1});
  EXPECT_FALSE(living.expired());
  EXPECT_FALSE(watcher->lost);
}

TEST_F(ClientSoak, AWatcherThatStopsReadingIsLetGoAndHoldsNoMemoryMeanwhile) {
  const RawPeer deaf{listener_->port()};
  ASSERT_TRUE(deaf.send(to_frame(Hello{kProtocolVersion, Side::Client, "soak", {}, {}})));
  pass_until([&] { return !at_site_.expired() && at_site_.lock()->is_ready(); });
  const std::weak_ptr<net::Connection> session = at_site_;
  for (std::uint64_t watch = 1; watch <= 60; ++watch)
    ASSERT_TRUE(deaf.send(to_frame(AskJobs{static_cast<RequestId>(watch), job_, 1, true})));
  std::size_t most = 0;
  int minutes_it_lasted = 0, minutes_it_was_full = 0;
  // It pings, so that it is not silent; what it is told is large and stays in its socket.
  for (; minutes_it_lasted < 240 && !session.expired(); ++minutes_it_lasted) {
    ASSERT_TRUE(
        store_->move(job_, JobState::Queued, std::string(60'000, static_cast<char>('a' + minutes_it_lasted % 26))));
    for (int i = 0; i < 6; ++i) {
      (void)deaf.send(Frame{FrameType::Ping, {}});
      loop_.pass(clock_, seconds{10});
      if (const auto open = session.lock()) most = std::max(most, open->queued_bytes());
    }
    minutes_it_was_full += most > 0;
  }
  EXPECT_TRUE(session.expired()) << "kept for four hours";
  EXPECT_GT(most, 0U) << "it was let go for taking nothing, not for saying nothing";
  EXPECT_LE(minutes_it_was_full, 2) << "a write has half a minute";
  EXPECT_LT(most, 1U << 20U);
}

}  // namespace
}  // namespace telefab::test
