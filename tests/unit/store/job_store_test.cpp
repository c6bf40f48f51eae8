// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <telefab/store/job_store.hpp>
#include <telefab/test/scratch_folder.hpp>
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
      // Back go a pause that ends, an approval that grew old, and a plan whose supports an operator changed.
      EXPECT_TRUE(is_before(from, to) || (from == JobState::Paused && to == JobState::Printing) ||
                  (from == JobState::Ready && to == JobState::AwaitingApproval) ||
                  (from == JobState::AwaitingApproval && to == JobState::Planning))
          << name_of(from) << " to " << name_of(to);
    }
  EXPECT_GT(allowed, 20);
  EXPECT_FALSE(may_follow(JobState::Paused, JobState::Done));
  EXPECT_FALSE(may_follow(JobState::Ready, JobState::Planning)) << "an approval is of one plan";
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
  std::unique_ptr<JobStore> open() { return JobStore::open(folder / "jobs.db", clock).value(); }

  test::ScratchFolder scratch;
  std::filesystem::path folder = scratch.path();
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

TEST_F(JobStoreTest, SendsAJobAgainThatAnotherFabIsToPrintUnlessItHasEnded) {
  auto store = open();
  const std::string id = store->create({.name = "a", .machine = "m", .id_prefix = "chicago-"}).value().id;
  EXPECT_TRUE(id.starts_with("chicago-j")) << id;
  ASSERT_TRUE(store->move(id, JobState::Printing, ""));
  ASSERT_TRUE(store->move(id, JobState::Paused, ""));
  EXPECT_EQ(store->move(id, JobState::Sending, "").error().code, ErrorCode::Conflict) << "not by itself";
  const auto again = store->send_again(id, "waits for a machine of the fleet");
  ASSERT_TRUE(again) << again.error().what;
  EXPECT_EQ(again->state, JobState::Sending);
  EXPECT_EQ(again->message, "waits for a machine of the fleet");
  ASSERT_TRUE(store->move(id, JobState::Done, ""));
  EXPECT_EQ(store->send_again(id, "").error().code, ErrorCode::Conflict);
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
  const auto page = store->list({.most = 10});
  ASSERT_THAT(page->jobs, SizeIs(2));
  EXPECT_EQ(page->jobs[0].id, second);
  EXPECT_EQ(page->next, 0U);
  EXPECT_THAT(store->list({.most = 1})->jobs, SizeIs(1));
}

TEST_F(JobStoreTest, ListsEveryJobOnceInPagesThoughJobsComeAndAreForgottenMeanwhile) {
  auto store = open();
  std::vector<std::string> ids;
  for (int i = 0; i < 25; ++i) ids.push_back(store->create({.name = std::to_string(i), .machine = "m"})->id);
  std::vector<std::string> seen;
  JobQuery query{.most = 10};
  do {
    const auto page = store->list(query).value();
    EXPECT_THAT(page.jobs, SizeIs(testing::Le(10U)));
    for (const Job& job : page.jobs) seen.push_back(job.id);
    query.before = page.next;
    ASSERT_TRUE(store->create({.name = "later", .machine = "m"}));
    ASSERT_TRUE(store->move(page.jobs.back().id, JobState::Cancelled, ""));
    ASSERT_TRUE(store->forget(page.jobs.back().id)) << "the last of a page, of all jobs";
  } while (query.before > 0);
  std::reverse(seen.begin(), seen.end());
  EXPECT_EQ(seen, ids);
}

TEST_F(JobStoreTest, FindsJobsByWhatPeopleKnowThemBy) {
  auto store = open();
  const std::string cup = store->create({.name = "Cup 50%.ply", .machine = "machine-a", .owner = "ana"})->id;
  const std::string vase = store->create({.name = "gro\u00df_vase.ply", .machine = "machine-b", .owner = "eve"})->id;
  ASSERT_TRUE(store->set_instance(vase, "hall-2"));
  ASSERT_TRUE(store->move(vase, JobState::Planning, ""));
  ASSERT_TRUE(store->move(vase, JobState::AwaitingApproval, ""));
  const auto found = [&](std::string words, std::vector<JobState> states = {}) {
    const JobPage page = store->list({.words = std::move(words), .states = std::move(states)}).value();
    std::vector<std::string> ids;
    for (const Job& job : page.jobs) ids.push_back(job.id);
    return ids;
  };
  EXPECT_THAT(found(""), ElementsAre(vase, cup));
  EXPECT_THAT(found("CUP"), ElementsAre(cup));
  EXPECT_THAT(found("50%"), ElementsAre(cup));
  EXPECT_THAT(found("%"), ElementsAre(cup)) << "a character like any other";
  EXPECT_THAT(found("_"), ElementsAre(vase));
  EXPECT_THAT(found("gro\u00df"), ElementsAre(vase));
  EXPECT_THAT(found("eve"), ElementsAre(vase));
  EXPECT_THAT(found("hall-2"), ElementsAre(vase));
  EXPECT_THAT(found("machine-a"), ElementsAre(cup));
  EXPECT_THAT(found(cup), ElementsAre(cup));
  EXPECT_THAT(found("Awaiting"), ElementsAre(vase));
  EXPECT_THAT(found("ply eve"), ElementsAre(vase)) << "every word";
  EXPECT_THAT(found("cup eve"), testing::IsEmpty());
  EXPECT_THAT(found("' OR '1'='1"), testing::IsEmpty());
  EXPECT_THAT(found("ply", {JobState::Queued, JobState::Done}), ElementsAre(cup));
}

TEST_F(JobStoreTest, CountsJobsThatAreNotAtTheirEndAmongTheCurrentHoweverManyCameAfter) {
  auto store = open();
  const std::string old = store->create({.name = "old", .machine = "m"})->id;
  for (int i = 0; i < 20; ++i) {
    const std::string id = store->create({.name = "ended", .machine = "m"})->id;
    ASSERT_TRUE(store->move(id, JobState::Cancelled, ""));
  }
  const auto current = store->current(5).value();
  ASSERT_THAT(current, SizeIs(6));
  EXPECT_EQ(current.back().id, old);
  EXPECT_THAT(store->current(100).value(), SizeIs(21));
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
  ASSERT_EQ(sqlite3_exec(database, "ALTER TABLE job DROP COLUMN instance; PRAGMA user_version = 1;", nullptr, nullptr,
                         nullptr),
            SQLITE_OK);
  sqlite3_close(database);
  for (int opened = 0; opened < 2; ++opened) {  // the second time there is nothing left to do
    auto store = open();
    EXPECT_EQ(store->find(held)->state, JobState::AwaitingApproval);
    EXPECT_EQ(store->find(held)->message, "waits for `telefab approve`: islands");
    EXPECT_EQ(store->find(free)->state, JobState::Ready);
    EXPECT_EQ(store->find(printing)->state, JobState::Printing);
    EXPECT_THAT(store->unfinished().value(), SizeIs(3));
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "jobs.db.schema-1")) << "as it was before";
}

TEST_F(JobStoreTest, TakesOverAStoreThatKnewOfOneMachineAProfile) {
  std::string job;
  {
    auto store = open();
    job = store->create({.name = "a.ply", .machine = "machine-a", .owner = "operator"}).value().id;
    ASSERT_TRUE(store->move(job, JobState::Printing, ""));
  }
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((folder / "jobs.db").c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "ALTER TABLE job DROP COLUMN instance; PRAGMA user_version = 3;", nullptr, nullptr,
                         nullptr),
            SQLITE_OK);
  sqlite3_close(database);
  auto store = open();
  EXPECT_EQ(store->find(job)->state, JobState::Printing);
  EXPECT_EQ(store->find(job)->instance, "") << "nobody knows yet";
  EXPECT_TRUE(std::filesystem::exists(folder / "jobs.db.schema-3")) << "as it was before";
}

TEST_F(JobStoreTest, KeepsTheMachineOfAJobAndTellsItsChangesAsEvents) {
  std::string job;
  {
    auto store = open();
    job = store->create({.name = "a.ply", .machine = "machine-a", .owner = "operator"}).value().id;
    ASSERT_TRUE(store->set_instance(job, "hall-1"));
    ASSERT_TRUE(store->set_instance(job, "hall-1")) << "nothing changes";
    ASSERT_TRUE(store->set_instance(job, "hall-2"));
    EXPECT_EQ(store->set_instance("nobody", "hall-1").error().code, ErrorCode::NotFound);
  }
  auto store = open();
  EXPECT_EQ(store->find(job)->instance, "hall-2");
  std::vector<std::string> texts;
  const auto events = store->events(job, 0, 100).value();
  for (const JobEvent& event : events) texts.push_back(event.text);
  EXPECT_THAT(texts, testing::ElementsAre("queued", "on machine hall-1", "on machine hall-2"));
}

TEST_F(JobStoreTest, RaisesItsRevisionWithEveryChangeOnly) {
  auto store = open();
  const auto before = store->revision();
  (void)store->list({});
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

TEST_F(JobStoreTest, RefusesAStoreOfANewerVersionByName) {
  open();
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((folder / "jobs.db").c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "PRAGMA user_version = 99;", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  const auto store = JobStore::open(folder / "jobs.db", clock);
  ASSERT_FALSE(store);
  EXPECT_EQ(store.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(store.error().what, HasSubstr("newer version of Telefab (schema 99"));
  EXPECT_FALSE(open_or_restore(folder / "jobs.db", clock)) << "nor is it set aside";
}

TEST_F(JobStoreTest, ForgetsOnlyWhatHasEndedAndNeverMakesItAgain) {
  auto store = open();
  const std::string job = store->create({.name = "a", .machine = "m", .owner = "ana"}).value().id;
  EXPECT_EQ(store->forget(job).error().code, ErrorCode::Conflict);
  EXPECT_FALSE(store->forgotten(job).value());
  ASSERT_TRUE(store->move(job, JobState::Failed, "no support holds it"));
  EXPECT_THAT(store->ended().value(), SizeIs(1));
  EXPECT_EQ(store->forget(job)->id, job);
  EXPECT_EQ(store->find(job).error().code, ErrorCode::NotFound);
  EXPECT_THAT(store->events(job, 0, 10).value(), SizeIs(0));
  store.reset();
  store = open();
  EXPECT_EQ(store->forgotten(job).value(), JobState::Failed);
  const auto again = store->create({.id = job, .name = "a", .machine = "m", .owner = "ana"});
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::Conflict);
  EXPECT_THAT(again.error().what, HasSubstr("ended as failed"));
}

class JobStoreBackup : public JobStoreTest {
 protected:
  /// A store of so many jobs, backed up before the last one was made.
  void make(int jobs) {
    auto store = open();
    for (int i = 0; i < jobs; ++i) {
      const bool is_backed_up = i + 1 < jobs || store->back_up();
      ASSERT_TRUE(is_backed_up);
      ASSERT_TRUE(store->create({.name = "a", .machine = "m", .owner = "ana"}));
    }
  }
  [[nodiscard]] std::filesystem::path path() const { return folder / "jobs.db"; }
  [[nodiscard]] std::filesystem::path beside(const std::string& ending) const { return path().string() + ending; }
  /// Flips bits in the middle of every page.
  static void damage(const std::filesystem::path& file) {
    std::fstream bytes{file, std::ios::in | std::ios::out | std::ios::binary};
    for (std::uint64_t at = 4096 + 8; at + 64 < std::filesystem::file_size(file); at += 4096) {
      bytes.seekp(static_cast<std::streamoff>(at));
      bytes << std::string(64, '\x7f');
    }
  }
};

TEST_F(JobStoreBackup, TakesThePlaceOfADamagedStoreAndSaysSo) {
  make(3);
  damage(path());
  ASSERT_FALSE(JobStore::open(path(), clock));
  EXPECT_EQ(JobStore::open(path(), clock).error().code, ErrorCode::NotTrusted);
  const auto restored = open_or_restore(path(), clock);
  ASSERT_TRUE(restored) << restored.error().what;
  EXPECT_THAT(restored->store->list({.most = 10})->jobs, SizeIs(2)) << "what came after the backup is lost";
  EXPECT_THAT(restored->notice, HasSubstr("jobs.db.damaged-1"));
  EXPECT_THAT(restored->notice, HasSubstr("jobs.db.backup-1 took its place"));
  EXPECT_TRUE(std::filesystem::exists(beside(".damaged-1")));
  ASSERT_TRUE(restored->store->create({.name = "a", .machine = "m", .owner = "ana"}));
  EXPECT_TRUE(open_or_restore(path(), clock)->notice.empty());
}

TEST_F(JobStoreBackup, AnOlderOneServesWhereTheNewestIsDamagedToo) {
  make(2);
  make(2);
  damage(path());
  damage(beside(".backup-1"));
  const auto restored = open_or_restore(path(), clock);
  ASSERT_TRUE(restored) << restored.error().what;
  EXPECT_THAT(restored->notice, HasSubstr("backup-2 took its place"));
  EXPECT_THAT(restored->store->list({.most = 10})->jobs, SizeIs(1));
}

TEST_F(JobStoreBackup, WithoutOneTheListBeginsEmptyAndTheDamagedFileStays) {
  std::ofstream{path()} << std::string(5000, 'x');
  const auto restored = open_or_restore(path(), clock);
  ASSERT_TRUE(restored) << restored.error().what;
  EXPECT_THAT(restored->notice, HasSubstr("begins empty"));
  EXPECT_EQ(std::filesystem::file_size(beside(".damaged-1")), 5000U);
}

// A kill while the damaged file is set aside leaves none; that is no new site.
TEST_F(JobStoreBackup, ServesWhereTheStoreIsMissing) {
  make(3);
  for (const char* part : {"", "-wal", "-shm"}) std::filesystem::remove(beside(part));
  const auto restored = open_or_restore(path(), clock);
  ASSERT_TRUE(restored);
  EXPECT_THAT(restored->notice, HasSubstr("is missing"));
  EXPECT_THAT(restored->store->list({.most = 10})->jobs, SizeIs(2));
}

TEST_F(JobStoreBackup, IsReadByNobodyWhoMayNotReadTheStore) {
  make(1);
  std::filesystem::permissions(path(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  make(1);
  EXPECT_EQ(std::filesystem::status(beside(".backup-1")).permissions(), std::filesystem::status(path()).permissions());
}

TEST_F(JobStoreBackup, SoManyAreKept) {
  for (int i = 0; i < 5; ++i) make(1);
  for (int number = 1; number <= kStoreBackups; ++number)
    EXPECT_TRUE(std::filesystem::exists(beside(".backup-" + std::to_string(number))));
  EXPECT_FALSE(std::filesystem::exists(beside(".backup-" + std::to_string(kStoreBackups + 1))));
  EXPECT_FALSE(std::filesystem::exists(beside(".backup-0")));
}

}  // namespace
}  // namespace telefab
