// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <telefab/store/job_store.hpp>
#include <thread>

namespace telefab {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

TEST(JobState, GoesForwardOnlyAndEndsForGood) {
  int allowed = 0;
  for (const JobState from : kJobStates)
    for (const JobState to : kJobStates) {
      if (!may_follow(from, to)) continue;
      ++allowed;
      EXPECT_FALSE(is_final(from)) << name_of(from);
      // Back go a pause that ends, and an approval that grew old.
      EXPECT_TRUE(is_before(from, to) || (from == JobState::Paused && to == JobState::Printing) ||
                  (from == JobState::Ready && to == JobState::AwaitingApproval))
          << name_of(from) << " to " << name_of(to);
    }
  EXPECT_GT(allowed, 20);
  EXPECT_FALSE(may_follow(JobState::Paused, JobState::Done));
  EXPECT_TRUE(may_follow(JobState::Planning, JobState::AwaitingApproval));
  EXPECT_TRUE(may_follow(JobState::AwaitingApproval, JobState::Ready));
  EXPECT_TRUE(may_follow(JobState::Ready, JobState::AwaitingApproval));
  EXPECT_FALSE(is_final(JobState::AwaitingApproval));
  EXPECT_TRUE(may_follow(JobState::Printing, JobState::Paused));
}

TEST(JobState, ComesBackFromItsName) {
  for (const JobState state : kJobStates) EXPECT_EQ(job_state_from_name(name_of(state)).value(), state);
  EXPECT_FALSE(job_state_from_name("lost"));
}

class JobStoreTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "telefab-store-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder = name;
  }
  void TearDown() override { std::filesystem::remove_all(folder); }
  std::unique_ptr<JobStore> open() { return JobStore::open(folder / "jobs.db", clock).value(); }

  std::filesystem::path folder;
  VirtualClock clock{std::chrono::hours{1}};
};

TEST_F(JobStoreTest, KeepsJobsCountersStagesAndEventsOverARestart) {
  std::string id;
  {
    auto store = open();
    id = store->create({.name = "statue.ply", .machine = "machine-a", .owner = "operator"}).value().id;
    ASSERT_TRUE(store->move(id, JobState::Slicing, ""));
    ASSERT_TRUE(store->set_counters(id, {.layers = 500, .layers_sliced = 7, .wire_bytes = 1ULL << 40U}));
    ASSERT_TRUE(store->set_stage_seconds(id, JobStage::Slice, 1.5));
    ASSERT_TRUE(store->set_stage_seconds(id, JobStage::Send, 0.5));
    ASSERT_TRUE(store->set_stage_seconds(id, JobStage::Slice, 2.5));
  }
  auto store = open();
  const auto job = store->find(id);
  ASSERT_TRUE(job);
  EXPECT_EQ(job->state, JobState::Slicing);
  EXPECT_EQ(job->counters.layers, 500U);
  EXPECT_EQ(job->counters.wire_bytes, 1ULL << 40U);
  EXPECT_THAT(job->stages, ElementsAre(StageSeconds{JobStage::Slice, 2.5}, StageSeconds{JobStage::Send, 0.5}));
  EXPECT_THAT(*store->events(id, 0, 100), SizeIs(2));
  EXPECT_THAT(*store->unfinished(), SizeIs(1));
}

TEST_F(JobStoreTest, RefusesAForbiddenMoveAndChangesNothing) {
  auto store = open();
  const std::string id = store->create({.name = "a", .machine = "m"}).value().id;
  ASSERT_TRUE(store->move(id, JobState::Cancelled, "asked for"));
  const auto moved = store->move(id, JobState::Printing, "");
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::Conflict);
  EXPECT_EQ(store->find(id)->message, "asked for");
  EXPECT_THAT(*store->unfinished(), SizeIs(0));
}

TEST_F(JobStoreTest, SaysNotFoundForAJobThatIsNotThere) {
  auto store = open();
  EXPECT_EQ(store->find("none").error().code, ErrorCode::NotFound);
  EXPECT_EQ(store->move("none", JobState::Failed, "").error().code, ErrorCode::NotFound);
  EXPECT_EQ(store->set_counters("none", {}).error().code, ErrorCode::NotFound);
  EXPECT_EQ(store->add_event("none", "x").error().code, ErrorCode::NotFound);
}

TEST_F(JobStoreTest, TakesTheOtherSitesIdOnce) {
  auto store = open();
  EXPECT_EQ(store->create({.id = "their-7", .name = "a", .machine = "m"}).value().id, "their-7");
  EXPECT_EQ(store->create({.id = "their-7", .name = "a", .machine = "m"}).error().code, ErrorCode::Conflict);
}

TEST_F(JobStoreTest, ListsTheNewestFirstEvenWithinOneMillisecond) {
  auto store = open();
  const std::string first = store->create({.name = "1", .machine = "m"}).value().id;
  const std::string second = store->create({.name = "2", .machine = "m"}).value().id;
  EXPECT_NE(first, second);
  const auto jobs = store->list(10);
  ASSERT_THAT(*jobs, SizeIs(2));
  EXPECT_EQ((*jobs)[0].id, second);
  EXPECT_THAT(*store->list(1), SizeIs(1));
}

TEST_F(JobStoreTest, TreatsTextAsTextAndNeverAsAStatement) {
  auto store = open();
  const std::string nasty = "'); DROP TABLE job; --\n\xc3\xa9";
  const auto job = store->create({.id = nasty, .name = nasty, .machine = nasty, .parameters = nasty, .owner = nasty});
  ASSERT_TRUE(job);
  EXPECT_EQ(store->find(nasty)->name, nasty);
}

TEST_F(JobStoreTest, RefusesAFileThatIsNoStoreWithoutTouchingIt) {
  const std::string noise(5000, 'x');
  std::ofstream{folder / "jobs.db"} << noise;
  const auto store = JobStore::open(folder / "jobs.db", clock);
  ASSERT_FALSE(store);
  EXPECT_THAT(store.error().what, HasSubstr("jobs.db"));
  std::ifstream in{folder / "jobs.db"};
  EXPECT_EQ((std::string{std::istreambuf_iterator<char>{in}, {}}), noise);
}

// Before there was a state for it, what waited for approval was ready with a message, and an approval took the message.
TEST_F(JobStoreTest, TakesOverAStoreInWhichAMessageMeantWaiting) {
  std::string held, free, printing;
  {
    auto store = open();
    for (std::string* id : {&held, &free, &printing}) {
      *id = store->create({.name = "a.ply", .machine = "machine-a", .owner = "operator"}).value().id;
      ASSERT_TRUE(store->move(*id, JobState::Ready, id == &held ? "waits for `telefab approve`: islands" : ""));
    }
    ASSERT_TRUE(store->move(printing, JobState::Printing, "warming up"));
  }
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((folder / "jobs.db").c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "PRAGMA user_version = 1;", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  for (int opened = 0; opened < 2; ++opened) {  // the second time there is nothing left to do
    auto store = open();
    EXPECT_EQ(store->find(held)->state, JobState::AwaitingApproval);
    EXPECT_EQ(store->find(held)->message, "waits for `telefab approve`: islands");
    EXPECT_EQ(store->find(free)->state, JobState::Ready);
    EXPECT_EQ(store->find(printing)->state, JobState::Printing);
    EXPECT_THAT(store->unfinished().value(), SizeIs(3));
  }
}

TEST_F(JobStoreTest, RaisesItsRevisionWithEveryChangeOnly) {
  auto store = open();
  const auto before = store->revision();
  (void)store->list(5);
  EXPECT_EQ(store->revision(), before);
  (void)store->create({.name = "a", .machine = "m"});
  EXPECT_GT(store->revision(), before);
}

TEST_F(JobStoreTest, LosesNoEventUnderSeveralThreads) {
  auto store = open();
  const std::string id = store->create({.name = "a", .machine = "m"}).value().id;
  {
    std::vector<std::jthread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        for (int i = 0; i < 10; ++i) EXPECT_TRUE(store->add_event(id, "tick"));
      });
  }
  EXPECT_THAT(*store->events(id, 0, 1000), SizeIs(41));
}

TEST_F(JobStoreTest, HoldsEveryAnsweredChangeAfterKill) {
  int pipe_ends[2];
  ASSERT_EQ(::pipe(pipe_ends), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    auto store = open();
    for (int i = 0; i < 1000; ++i) {
      const auto job = store->create({.id = "job-" + std::to_string(i), .name = "a", .machine = "m"});
      if (!job || ::write(pipe_ends[1], "x", 1) != 1) ::_exit(1);
    }
    ::_exit(0);
  }
  char byte = 0;
  for (int i = 0; i < 20; ++i) ASSERT_EQ(::read(pipe_ends[0], &byte, 1), 1);
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  ::close(pipe_ends[1]);
  int answered = 20;
  while (::read(pipe_ends[0], &byte, 1) == 1) ++answered;
  ::close(pipe_ends[0]);
  auto store = open();
  for (int i = 0; i < answered; ++i) EXPECT_TRUE(store->find("job-" + std::to_string(i))) << i;
}

}  // namespace
}  // namespace telefab
