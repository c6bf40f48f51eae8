// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <atomic>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/service/disk_room.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

// What a fab without room does: it waits, says so, and goes on by itself. A disk that is full loses no job.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr std::uint64_t kPlenty_bytes = 1ULL << 40U;

/// The fab of this process, whose disk is as large and as full as the test says; the scan site a process of its own.
class Room : public TwoSites {
 protected:
  void start_fab_here(std::chrono::milliseconds retry_every = 50ms) {
    fab::FabSiteConfig config;
    config.serve.listen = "127.0.0.1:0";
    config.serve.data = (folder() / "fab").string();
    config.serve.machines = (folder() / "machines").string();
    config.serve.log_level = "warning";
    config.serve.reserve_mib = 1;
    config.serve.retry_every = retry_every;
    config.serve.web = "127.0.0.1:0";
    config.serve.ask_space = [this](const fs::path&) -> Result<fs::space_info> {
      const std::uint64_t free = is_full() ? 0 : kPlenty_bytes;
      return fs::space_info{capacity, free, free};
    };
    fab_thread_ = std::jthread{[this, config](const std::stop_token& stop) {
      const SystemClock clock;
      const auto served = fab::serve_fab_site(config, clock, stop);
      EXPECT_TRUE(served) << served.error().what;
    }};
    ASSERT_TRUE(await([&] { return text_of(folder() / "fab" / "port").ends_with('\n'); }));
    std::string port = text_of(folder() / "fab" / "port");
    port.pop_back();
    set_way_to_fab("127.0.0.1:" + port);
  }
  template <class Condition>
  static bool await(Condition condition) {
    for (int tries = 0; tries < 2000; ++tries, std::this_thread::sleep_for(5ms))
      if (condition()) return true;
    return condition();
  }
  [[nodiscard]] std::string jobs() const { return telefab({"jobs"}).output; }
  /// The whole answer.
  [[nodiscard]] std::string health() const {
    return http_ask(static_cast<std::uint16_t>(std::stoi(text_of(folder() / "fab" / "web-port"))), "GET", "/v1/health");
  }
  void TearDown() override { fab_thread_ = {}; }

  std::atomic<std::uint64_t> capacity{kPlenty_bytes};
  std::atomic<bool> is_full_for_offers{false}, is_full_for_plans{false}, is_full_for_prints{false};

 private:
  /// By what the fab's jobs are waiting for.
  [[nodiscard]] bool is_full() const {
    std::error_code error;
    bool has_stack = false, has_plan = false;
    for (const auto& job : fs::directory_iterator{folder() / "fab" / "jobs", error}) {
      has_stack |= fs::exists(job.path() / "end");
      has_plan |= fs::exists(job.path() / "plan");
    }
    return has_plan ? is_full_for_prints : has_stack ? is_full_for_plans : is_full_for_offers;
  }
  std::jthread fab_thread_;
};

TEST(DiskRoom, LeavesRoomForWhatIsOnItsWay) {
  const ScratchFolder folder;
  std::uint64_t free_bytes = 100U << 20U;
  DiskRoom room{folder.path(), 0, [&](const fs::path&) -> Result<fs::space_info> {
                  return fs::space_info{kPlenty_bytes, free_bytes, free_bytes};
                }};
  EXPECT_TRUE(room.check(60U << 20U));
  room.expect("a scan", 60U << 20U);
  EXPECT_EQ(room.room().value(), 40U << 20U);
  const auto second = room.check(60U << 20U);
  ASSERT_FALSE(second) << "two that fit alone do not fit together";
  EXPECT_EQ(second.error().code, ErrorCode::StorageFailed);
  EXPECT_THAT(second.error().what,
              HasSubstr("100 MiB of disk are free, 60 are needed beside 60 that are on their way"));
  EXPECT_TRUE(room.check(40U << 20U));
  // What has arrived is used, and no longer expected.
  free_bytes = 50U << 20U;
  room.expect("a scan", 10U << 20U);
  EXPECT_TRUE(room.check(40U << 20U));
  EXPECT_FALSE(room.check(41U << 20U));
  room.expect("a scan", 0);
  EXPECT_TRUE(room.check(50U << 20U));
  free_bytes = 0;
  room.expect("a scan", 10U << 20U);
  EXPECT_TRUE(room.check(0)) << "only the reserve is asked for, and there is none";
}

TEST_F(Room, AFullFabPutsAnOfferOffAndTheScanSiteOffersItAgain) {
  is_full_for_offers = true;
  start_fab_here();
  start_scan();
  const std::string job = submit_torus();
  ASSERT_TRUE(await([&] { return jobs().find("waits: the fab is full") != std::string::npos; })) << jobs();
  EXPECT_THAT(jobs(), HasSubstr("0 MiB of disk are free"));
  EXPECT_FALSE(fs::exists(folder() / "fab" / "jobs" / job)) << "nothing is begun that cannot be ended";
  is_full_for_offers = false;
  const Outcome watched = telefab({"watch", job});
  EXPECT_EQ(watched.code, 0) << watched.output;
  EXPECT_THAT(jobs(), testing::Not(HasSubstr("waits")));
}

TEST_F(Room, AJobWaitsBeforeItsPlanAndBeforeItsPrintAndGoesOnByItself) {
  is_full_for_plans = is_full_for_prints = true;
  start_fab_here();
  start_scan();
  const std::string job = submit_torus();
  const auto waits = [&] { return jobs().find("waits: the fab is full") != std::string::npos; };
  ASSERT_TRUE(await(waits)) << jobs();
  EXPECT_THAT(jobs(), HasSubstr("planning"));
  EXPECT_FALSE(fs::exists(folder() / "fab" / "jobs" / job / "plan"));
  is_full_for_plans = false;
  ASSERT_TRUE(await([&] { return fs::exists(folder() / "fab" / "jobs" / job / "plan" / "plan.json"); })) << jobs();
  ASSERT_TRUE(await([&] { return jobs().find("ready") != std::string::npos && waits(); })) << jobs();
  EXPECT_FALSE(fs::exists(folder() / "fab" / "jobs" / job / "report" / "print.json"));
  is_full_for_prints = false;
  const Outcome watched = telefab({"watch", job});
  EXPECT_EQ(watched.code, 0) << watched.output;
  EXPECT_TRUE(fs::exists(folder() / "fab" / "jobs" / job / "report" / "as-built.json"));
}

// What another job finds of the disk, or the look after the reserve, says nothing of the job that waits.
TEST_F(Room, HealthNamesAJobThatWaitsUntilItGoesOnThoughOthersFindRoom) {
  is_full_for_plans = true;
  start_fab_here(60s);
  start_scan();
  EXPECT_THAT(health(), HasSubstr(" 200 "));
  const std::string large = submit_torus();
  ASSERT_TRUE(await([&] { return jobs().find("waits: the fab is full") != std::string::npos; })) << jobs();
  EXPECT_THAT(health(), HasSubstr(" 503 "));
  is_full_for_plans = false;
  const std::string small = submit_torus();
  EXPECT_EQ(telefab({"watch", small}).code, 0) << "there is room again, and the first has not looked yet";
  EXPECT_THAT(health(), HasSubstr(" 503 "));
  EXPECT_THAT(health(), HasSubstr("job " + large + " waits: the fab is full"));
  EXPECT_EQ(telefab({"cancel", large}).code, 0);
  EXPECT_TRUE(await([&] { return health().find(" 200 ") != std::string::npos; })) << health();
}

TEST_F(Room, HealthNamesAnOfferThatIsPutOffUntilItIsTaken) {
  is_full_for_offers = true;
  start_fab_here();
  start_scan();
  const std::string job = submit_torus();
  ASSERT_TRUE(await([&] { return jobs().find("waits: the fab is full") != std::string::npos; })) << jobs();
  EXPECT_THAT(health(), HasSubstr(" 503 "));
  is_full_for_offers = false;
  EXPECT_EQ(telefab({"watch", job}).code, 0);
  EXPECT_THAT(health(), HasSubstr(" 200 "));
}

TEST_F(Room, AJobThatWaitsForRoomCanBeCancelled) {
  is_full_for_plans = true;
  start_fab_here();
  start_scan();
  const std::string job = submit_torus();
  ASSERT_TRUE(await([&] { return jobs().find("waits: the fab is full") != std::string::npos; })) << jobs();
  EXPECT_EQ(telefab({"cancel", job}).code, 0);
  is_full_for_plans = false;
  std::this_thread::sleep_for(300ms);  // several tries
  EXPECT_THAT(jobs(), HasSubstr("cancelled"));
  EXPECT_FALSE(fs::exists(folder() / "fab" / "jobs" / job / "plan"));
}

TEST_F(Room, ADiskThatIsTooSmallForTheJobRefusesItForGood) {
  capacity = 2U << 20U;
  start_fab_here();
  start_scan();
  const std::string job = submit_torus();
  EXPECT_EQ(telefab({"watch", job}).code, 5) << jobs();
  EXPECT_THAT(jobs(), HasSubstr("the fab refused it: the disk of 2 MiB is too small"));
}

class Reserve : public TwoSites {};

TEST_F(Reserve, LiesOnTheDiskUntilItIsGivenUpAndIsTakenBackOnceThereIsRoom) {
  std::atomic<std::uint64_t> free{kPlenty_bytes};
  DiskRoom room{folder(), 1U << 20U, [&](const fs::path&) -> Result<fs::space_info> {
                  return fs::space_info{kPlenty_bytes, free, free};
                }};
  EXPECT_EQ(fs::file_size(folder() / "reserve"), 1U << 20U);
  EXPECT_TRUE(room.health());
  free = 1000;
  EXPECT_TRUE(room.check(1000)) << "the reserve is not part of what is free";
  const auto full = room.check(1001);
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().code, ErrorCode::StorageFailed);
  EXPECT_FALSE(room.health());

  EXPECT_TRUE(room.give_up_reserve());
  EXPECT_FALSE(fs::exists(folder() / "reserve"));
  EXPECT_FALSE(room.give_up_reserve()) << "there is no second one";
  EXPECT_FALSE(room.check(0)) << "nothing else is begun before it is whole again";
  free = 1U << 20U;
  EXPECT_FALSE(room.check(1));
  EXPECT_TRUE(room.check(0));
  EXPECT_EQ(fs::file_size(folder() / "reserve"), 1U << 20U);
  EXPECT_TRUE(room.health());
}

TEST_F(Reserve, IsNotAllThatHealthLooksAt) {
  DiskRoom room{folder(), 0, [&](const fs::path&) -> Result<fs::space_info> {
                  return fs::space_info{kPlenty_bytes, kPlenty_bytes, kPlenty_bytes};
                }};
  room.wait("j1", {ErrorCode::StorageFailed, "9 MiB of disk are free, 10 are needed"});
  room.wait("j2", {ErrorCode::StorageFailed, "another reason"});
  EXPECT_TRUE(room.check(0));
  EXPECT_EQ(room.health().error().what, "job j1 waits: 9 MiB of disk are free, 10 are needed; 1 more wait");
  room.go_on("j1");
  EXPECT_EQ(room.health().error().what, "job j2 waits: another reason");
  room.go_on("j2");
  EXPECT_TRUE(room.health());
}

TEST_F(Reserve, RefusesForGoodOnlyWhatTheWholeDiskCouldNotHold) {
  DiskRoom room{folder(), 1U << 20U, [](const fs::path&) -> Result<fs::space_info> {
                  return fs::space_info{10U << 20U, 5U << 20U, 5U << 20U};
                }};
  EXPECT_EQ(room.check(6U << 20U).error().code, ErrorCode::StorageFailed);
  EXPECT_EQ(room.check(10U << 20U).error().code, ErrorCode::TooLarge);
}

}  // namespace
}  // namespace telefab::test
