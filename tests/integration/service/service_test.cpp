// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <telefab/service/job_tracker.hpp>
#include <telefab/service/service_notifier.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/test/two_sites.hpp>

// What a service manager hears of the two daemons.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

/// No file can grow while it lives, as on a full disk. Nothing may be printed meanwhile.
class FullDisk {
 public:
  FullDisk() {
    ::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &usual_);
    const rlimit none{1, usual_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &none);
  }
  ~FullDisk() { ::setrlimit(RLIMIT_FSIZE, &usual_); }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit usual_{};
};

class Books : public testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path folder() const { return folder_.path(); }

 private:
  ScratchFolder folder_;
};

// A disk that was full for seconds once left a job dark, and "printing 20 %" for good.
TEST_F(Books, AreCaughtUpInOrderOnceADiskThatWasFullHasRoomAgain) {
  const SystemClock clock;
  net::Loop loop;
  const auto tracker = JobTracker::open(folder(), {}, clock, loop).value();
  const std::string job = tracker->store().create({{}, "a", "toy", "{}", "ana"}).value().id;
  tracker->move(job, JobState::Slicing, "");
  Result<void> during;
  {
    const FullDisk full;
    tracker->move(job, JobState::Sending, "");
    tracker->move(job, JobState::Planning, "supports");
    tracker->end(job, JobState::Failed, "no support holds it");
    tracker->note("ana", "cancel " + job);
    during = tracker->store().health();
  }
  ASSERT_FALSE(during);
  EXPECT_EQ(during.error().code, ErrorCode::StorageFailed);
  EXPECT_EQ(tracker->store().find(job)->state, JobState::Slicing);
  for (int tries = 0; tries < 200 && !is_final(tracker->store().find(job)->state); ++tries) loop.run_for(50ms);
  const auto now = tracker->store().find(job).value();
  EXPECT_EQ(now.state, JobState::Failed);
  EXPECT_EQ(now.message, "no support holds it");
  EXPECT_TRUE(tracker->store().health());
  EXPECT_EQ(tracker->store().events(job, 0, 100)->size(), 5U) << "each move, and in order";
  std::ifstream audit{folder() / "audit.log"};
  const std::string lines{std::istreambuf_iterator<char>{audit}, {}};
  EXPECT_THAT(lines, HasSubstr("cancel " + job));
}

// The other site is sent a job as it is stored: one that is done with seven of its ten layers printed stays so there.
TEST_F(Books, KeepTheCountersOfAJobBeforeItsEnd) {
  const SystemClock clock;
  net::Loop loop;
  const auto tracker = JobTracker::open(folder(), {}, clock, loop).value();
  const std::string job = tracker->store().create({{}, "a", "toy", "{}", "ana"}).value().id;
  tracker->move(job, JobState::Printing, "");
  tracker->counters().begin(job, {});
  {
    const FullDisk full;
    tracker->counters().change(job, [](JobCounters& c) { c.layers_printed = 10; });
    tracker->set_stage_seconds(job, JobStage::Print, 7);
    tracker->end(job, JobState::Done, "");
  }
  EXPECT_FALSE(tracker->counters().contains(job)) << "whoever works on it has forgotten it";
  for (int tries = 0; tries < 200 && !is_final(tracker->store().find(job)->state); ++tries) {
    EXPECT_EQ(tracker->store().find(job)->state, JobState::Printing);
    loop.run_for(50ms);
  }
  const auto now = tracker->store().find(job).value();
  EXPECT_EQ(now.state, JobState::Done);
  EXPECT_EQ(now.counters.layers_printed, 10U);
  ASSERT_EQ(now.stages.size(), 1U);
  EXPECT_EQ(now.stages[0].seconds, 7);
}

TEST_F(Books, GiveTheReserveUpForWhatCannotBeWrittenOtherwise) {
  const SystemClock clock;
  net::Loop loop;
  DiskRoom room{folder(), 1U << 20U};
  const auto tracker = JobTracker::open(folder(), {}, clock, loop, &room).value();
  const std::string job = tracker->store().create({{}, "a", "toy", "{}", "ana"}).value().id;
  ASSERT_TRUE(room.health());
  {
    const FullDisk full;
    tracker->move(job, JobState::Slicing, "");
  }
  EXPECT_FALSE(std::filesystem::exists(folder() / "reserve"));
  EXPECT_FALSE(room.health());
  EXPECT_TRUE(room.check(0)) << "there is room again";
  EXPECT_TRUE(std::filesystem::exists(folder() / "reserve"));
  EXPECT_TRUE(room.health());
}

TEST_F(Books, OfADamagedListAreRestoredAndNameTheFoldersThatItNoLongerKnows) {
  const SystemClock clock;
  net::Loop loop;
  std::string kept, lost;
  {
    const auto tracker = JobTracker::open(folder(), {}, clock, loop).value();
    kept = tracker->store().create({{}, "a", "toy", "{}", "ana"}).value().id;
    ASSERT_TRUE(tracker->store().back_up());
    lost = tracker->store().create({{}, "b", "toy", "{}", "ana"}).value().id;
  }
  for (const std::string& job : {kept, lost}) std::filesystem::create_directories(folder() / "jobs" / job);
  std::ofstream{folder() / "jobs.sqlite"} << std::string(9000, 'x');
  const auto tracker = JobTracker::open(folder(), {}, clock, loop);
  ASSERT_TRUE(tracker) << tracker.error().what;
  EXPECT_TRUE((*tracker)->store().find(kept));
  EXPECT_FALSE((*tracker)->store().find(lost));
  std::ifstream audit{folder() / "audit.log"};
  const std::string lines{std::istreambuf_iterator<char>{audit}, {}};
  EXPECT_THAT(lines, HasSubstr("jobs.sqlite.backup-1 took its place"));
  EXPECT_THAT(lines, HasSubstr("jobs/" + lost + " is of a job that is not in the list"));
  EXPECT_THAT(lines, testing::Not(HasSubstr("jobs/" + kept)));
}

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
