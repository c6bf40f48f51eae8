// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <telefab/service/service_notifier.hpp>

#include "two_sites.hpp"

// What a service manager hears of the two daemons.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

class Service : public TwoSites {
 protected:
  void SetUp() override {
    const std::string path = (folder() / "notify").string();
    socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    ASSERT_LT(path.size(), sizeof address.sun_path);
    path.copy(address.sun_path, path.size());
    ASSERT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    ::setenv("NOTIFY_SOCKET", path.c_str(), 1);
    ::setenv("WATCHDOG_USEC", "300000", 1);
  }
  void TearDown() override {
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
    ::close(socket_);
  }
  /// The next datagram; empty when none comes.
  [[nodiscard]] std::string next_word() const {
    pollfd p{socket_, POLLIN, 0};
    if (::poll(&p, 1, 20'000) <= 0) return {};
    std::array<char, 512> text{};
    const ssize_t n = ::recv(socket_, text.data(), text.size(), 0);
    return n > 0 ? std::string{text.data(), static_cast<std::size_t>(n)} : std::string{};
  }
  /// Words up to the one that is waited for.
  [[nodiscard]] bool comes(std::string_view word) const {
    for (std::string line = next_word(); !line.empty(); line = next_word())
      if (line.find(word) != std::string::npos) return true;
    return false;
  }
  void expect_a_life(Process& daemon) const {
    EXPECT_THAT(next_word(), HasSubstr("READY=1"));
    for (int i = 0; i < 3; ++i) EXPECT_THAT(next_word(), HasSubstr("WATCHDOG=1"));
    daemon.send_signal(SIGTERM);
    EXPECT_TRUE(comes("STOPPING=1"));
    EXPECT_EQ(daemon.finish(), 0);
  }

 private:
  int socket_ = -1;
};

TEST_F(Service, HearsThatTheFabIsReadyLivesAndStops) {
  start_fab();
  expect_a_life(fab());
}

TEST_F(Service, HearsThatTheScanSiteIsReadyLivesAndStops) {
  ::unsetenv("NOTIFY_SOCKET");
  start_fab();
  ::setenv("NOTIFY_SOCKET", (folder() / "notify").c_str(), 1);
  start_scan();
  expect_a_life(scan());
}

TEST(Heartbeat, TakesAThreadForDeadWhenItsCountStandsStillForTooLong) {
  Heartbeat beat{30s};
  EXPECT_TRUE(beat.is_alive(5, 0s));
  EXPECT_TRUE(beat.is_alive(5, 30s));
  EXPECT_FALSE(beat.is_alive(5, 31s));
  EXPECT_TRUE(beat.is_alive(6, 32s)) << "it goes on";
  EXPECT_FALSE(beat.is_alive(6, 63s));
  EXPECT_TRUE(beat.is_alive({}, 64s)) << "nothing to do";
  EXPECT_TRUE(beat.is_alive({}, 1000s));
  EXPECT_TRUE(beat.is_alive(6, 1001s)) << "a new print may begin where the last one ended";
}

}  // namespace
}  // namespace telefab::test
