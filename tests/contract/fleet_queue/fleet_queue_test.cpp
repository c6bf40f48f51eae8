// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <mutex>
#include <random>
#include <set>
#include <telefab/store/fleet_queue.hpp>
#include <telefab/test/postgres_server.hpp>
#include <thread>

// What a fleet's queue promises, of both its forms; PostgreSQL is skipped where there is no server.

namespace telefab {
namespace {

using namespace std::chrono_literals;
using fleet::Machine;
using fleet::NewJob;
using fleet::State;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

enum class Form : std::uint8_t { File, Database };

class FleetQueueTest : public testing::TestWithParam<Form> {
 protected:
  static void TearDownTestSuite() { server() = nullptr; }
  static std::unique_ptr<test::PostgresServer>& server() {
    static auto one = test::PostgresServer::start();
    return one;
  }
  void SetUp() override {
    if (GetParam() == Form::File) return;
    if (!server()) GTEST_SKIP() << "no PostgreSQL 15 server on this computer";
    static int number = 0;
    uri_ = server()->uri_of(fmt::format("fleet{}", ++number));
  }
  [[nodiscard]] Result<std::unique_ptr<FleetQueue>> opened() {
    return GetParam() == Form::File ? open_fleet_file(scratch_.path() / "fleet.sqlite", clock_)
                                    : open_fleet_database(uri_);
  }
  [[nodiscard]] std::unique_ptr<FleetQueue> open() { return opened().value(); }
  /// So long leases last at least, and this ends them.
  void let_pass(Nanoseconds time) { clock_.sleep_for(time); }

  static Machine machine(const std::string& name, const std::string& resin = "grey") {
    Machine m;
    m.name = name, m.profile = "class-a", m.light = "l1", m.resin = resin;
    m.width_mm = 120, m.depth_mm = 68, m.height_mm = 150, m.pixel_mm = 0.05;
    return m;
  }
  static NewJob job(const std::string& id, int priority = 0) {
    NewJob j;
    j.id = id, j.name = id + ".ply", j.owner = "ana", j.site = "chicago", j.stack_key = "key-of-" + id;
    j.priority = priority;
    return j;
  }
  static void announce(FleetQueue& queue, const std::vector<Machine>& machines, const std::string& fab = "la") {
    const auto done = queue.announce({fab, "127.0.0.1:7420", "", "{}"}, machines);
    ASSERT_TRUE(done) << done.error().what;
  }

  test::ScratchFolder scratch_;
  std::string uri_;
  SystemClock clock_;
};

TEST_P(FleetQueueTest, GivesAMachineTheFirstJobByPriorityDeadlineAndOrder) {
  auto queue = open();
  announce(*queue, {machine("a1"), machine("a2"), machine("a3"), machine("a4")});
  ASSERT_TRUE(queue->submit(job("first")));
  auto soon = job("soon");
  soon.deadline_unix_ms = 2'000'000'000'000;
  ASSERT_TRUE(queue->submit(soon));
  ASSERT_TRUE(queue->submit(job("urgent", 5)));
  std::vector<std::string> order;
  for (const char* name : {"a3", "a1", "a2"}) {
    const auto lease = queue->claim(name, 10s);
    ASSERT_TRUE(lease && *lease) << (lease ? "nothing" : lease.error().what);
    EXPECT_EQ((*lease)->attempt, 1U);
    EXPECT_FALSE((*lease)->is_bound);
    order.push_back((*lease)->job);
  }
  EXPECT_THAT(order, ElementsAre("urgent", "soon", "first"));
  EXPECT_FALSE(*queue->claim("a4", 10s)) << "nothing waits";
  EXPECT_EQ(queue->claim("a1", 10s).error().code, ErrorCode::Conflict) << "it has one";
  EXPECT_EQ(queue->find("urgent")->machine, "a3");
  EXPECT_EQ(queue->find("urgent")->state, State::Claimed);
}

TEST_P(FleetQueueTest, GivesOneOfSeveralMachinesTheFirstJobThatAnyOfThemFits) {
  auto queue = open();
  announce(*queue, {machine("a1"), machine("a2", "tough"), machine("a3")});
  auto tough = job("tough");
  tough.needs.resin = "tough";
  for (const NewJob& each : {tough, job("any"), job("other")}) ASSERT_TRUE(queue->submit(each));
  const std::vector<std::string> all{"a1", "a2", "a3"};
  std::vector<std::string> given;
  for (int i = 0; i < 3; ++i) {
    const auto lease = queue->claim(all, 10s);
    ASSERT_TRUE(lease && *lease) << (lease ? "nothing" : lease.error().what);
    given.push_back((*lease)->job + " on " + (*lease)->machine);
    EXPECT_EQ(queue->find((*lease)->job)->machine, (*lease)->machine);
  }
  EXPECT_THAT(given, ElementsAre("tough on a2", "any on a1", "other on a3"));
  EXPECT_EQ(queue->claim(all, 10s).error().code, ErrorCode::Conflict) << "each has one";
  ASSERT_TRUE(*queue->finish("any", 1, State::Done, ""));
  const auto none = queue->claim(all, 10s);
  ASSERT_TRUE(none) << none.error().what;
  EXPECT_FALSE(*none) << "one is idle, and nothing waits";
}

TEST_P(FleetQueueTest, IsMadeOnceThoughManyComeFirst) {
  std::vector<std::thread> sites;
  std::mutex mutex;
  std::vector<std::string> errors;
  for (int i = 0; i < 12; ++i)
    sites.emplace_back([&] {
      const auto queue = opened();
      const std::lock_guard lock{mutex};
      if (!queue) errors.push_back(queue.error().what);
    });
  for (std::thread& site : sites) site.join();
  EXPECT_THAT(errors, SizeIs(0));
  ASSERT_TRUE(open()->submit(job("vase")));
}

TEST_P(FleetQueueTest, KeepsWhatItAnsweredOverItsEnd) {
  {
    auto queue = open();
    announce(*queue, {machine("a1")});
    ASSERT_TRUE(queue->submit(job("vase")));
    ASSERT_TRUE(*queue->claim("a1", 10s));
    ASSERT_TRUE(*queue->bind("vase", 1));
  }
  auto queue = open();
  const auto leases = queue->leases_of("a1").value();
  ASSERT_THAT(leases, SizeIs(1));
  EXPECT_EQ(leases[0].job, "vase");
  EXPECT_EQ(leases[0].attempt, 1U);
  EXPECT_TRUE(leases[0].is_bound);
  EXPECT_GT(leases[0].left_ms, 0);
  EXPECT_EQ(queue->find("vase")->state, State::Bound);
}

TEST_P(FleetQueueTest, TakesASubmitAgainForTheSameAndRefusesAnotherJobOfThatId) {
  auto queue = open();
  auto three = job("gear");
  three.copies = 3;
  const auto copies = queue->submit(three).value();
  ASSERT_THAT(copies, SizeIs(3));
  EXPECT_EQ(copies[0].id, "gear");
  EXPECT_EQ(copies[2].id, "gear-c3");
  EXPECT_EQ(copies[2].stack_key, copies[0].stack_key);
  EXPECT_THAT(queue->submit(three).value(), SizeIs(3)) << "the answer was lost, and it is told again";
  EXPECT_THAT(queue->jobs({}, 0, 100).value(), SizeIs(3));
  three.needs.resin = "tough";
  EXPECT_EQ(queue->submit(three).error().code, ErrorCode::Conflict);
  three.id = "other", three.copies = 0;
  EXPECT_EQ(queue->submit(three).error().code, ErrorCode::InvalidInput);
}

TEST_P(FleetQueueTest, GivesAJobThatIsNotBoundToAnotherOnceItsLeaseRanOutAndTheFirstNeverGetsItBack) {
  auto queue = open();
  announce(*queue, {machine("a1"), machine("a2")});
  ASSERT_TRUE(queue->submit(job("vase")));
  ASSERT_TRUE(*queue->claim("a1", 50ms));
  EXPECT_TRUE(*queue->renew("vase", 1, 50ms));
  EXPECT_EQ(queue->expire().value(), 0U);
  let_pass(80ms);
  EXPECT_EQ(queue->expire().value(), 1U);
  EXPECT_EQ(queue->find("vase")->state, State::Waiting);
  const auto second = queue->claim("a2", 10s).value();
  ASSERT_TRUE(second);
  EXPECT_EQ(second->attempt, 2U);
  EXPECT_FALSE(*queue->renew("vase", 1, 10s));
  EXPECT_FALSE(*queue->bind("vase", 1)) << "it may not light";
  EXPECT_FALSE(*queue->release("vase", 1, "late"));
  EXPECT_FALSE(*queue->finish("vase", 1, State::Done, "")) << "what it says is of an attempt that is over";
  EXPECT_EQ(queue->find("vase")->machine, "a2");
}

TEST_P(FleetQueueTest, AsksAboutABoundJobWhoseFabIsSilentAndGivesItToNobodyElse) {
  auto queue = open();
  announce(*queue, {machine("a1"), machine("a2")});
  ASSERT_TRUE(queue->submit(job("vase")));
  ASSERT_TRUE(*queue->claim("a1", 50ms));
  ASSERT_TRUE(*queue->bind("vase", 1));
  let_pass(80ms);
  EXPECT_EQ(queue->expire().value(), 1U);
  EXPECT_EQ(queue->find("vase")->state, State::Asking);
  EXPECT_FALSE(*queue->claim("a2", 10s));
  EXPECT_EQ(queue->cancel("vase", "ana").error().code, ErrorCode::Conflict);
  EXPECT_FALSE(*queue->release("vase", 1, "why")) << "its part may hang there";
  // The fab is heard of again: it went on all the time.
  ASSERT_TRUE(*queue->renew("vase", 1, 50ms));
  EXPECT_EQ(queue->find("vase")->state, State::Bound);
  let_pass(80ms);
  EXPECT_EQ(queue->expire().value(), 1U);
  EXPECT_EQ(queue->decide("vase", State::Cancelled, "bo").error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(queue->decide("vase", State::Waiting, "bo")->state, State::Waiting);
  EXPECT_EQ(queue->decide("vase", State::Done, "bo").error().code, ErrorCode::Conflict) << "nothing is open now";
  EXPECT_FALSE(*queue->renew("vase", 1, 10s)) << "somebody decided that this attempt is over";
  EXPECT_EQ((*queue->claim("a2", 10s))->attempt, 2U);
}

TEST_P(FleetQueueTest, EndsAJobOnceAndTakesTheSameWordAgainForTheSame) {
  auto queue = open();
  announce(*queue, {machine("a1")});
  ASSERT_TRUE(queue->submit(job("vase")));
  ASSERT_TRUE(*queue->claim("a1", 10s));
  EXPECT_EQ(queue->finish("vase", 1, State::Waiting, "").error().code, ErrorCode::InvalidInput);
  EXPECT_TRUE(*queue->finish("vase", 1, State::Done, "light: by the fab"));
  EXPECT_TRUE(*queue->finish("vase", 1, State::Done, "light: by the fab")) << "the answer was lost";
  EXPECT_FALSE(*queue->finish("vase", 1, State::Failed, ""));
  EXPECT_EQ(queue->find("vase")->message, "light: by the fab");
  EXPECT_EQ(queue->cancel("vase", "ana").error().code, ErrorCode::Conflict);
  ASSERT_TRUE(queue->submit(job("cup")));
  EXPECT_EQ((*queue->claim("a1", 10s))->job, "cup") << "the machine is free for the next";
}

TEST_P(FleetQueueTest, ReleasesAndCancelsWhatIsNotLit) {
  auto queue = open();
  announce(*queue, {machine("a1")});
  ASSERT_TRUE(queue->submit(job("vase")));
  ASSERT_TRUE(*queue->claim("a1", 10s));
  ASSERT_TRUE(*queue->release("vase", 1, "the vat is empty"));
  EXPECT_EQ(queue->find("vase")->message, "the vat is empty");
  ASSERT_TRUE(*queue->claim("a1", 10s));
  EXPECT_EQ(queue->cancel("vase", "ana")->state, State::Cancelled);
  EXPECT_FALSE(*queue->bind("vase", 2)) << "it was cancelled under the fab's hands";
  EXPECT_THAT(queue->leases_of("a1").value(), SizeIs(0));
  EXPECT_EQ(queue->find("nobody").error().code, ErrorCode::NotFound);
  EXPECT_EQ(queue->cancel("nobody", "ana").error().code, ErrorCode::NotFound);
}

TEST_P(FleetQueueTest, GivesNothingToAMachineThatDrainsIsNotFreeOrDoesNotFit) {
  auto queue = open();
  auto busy = machine("busy"), blue = machine("blue", "blue"), small = machine("small"), coarse = machine("coarse"),
       other = machine("other"), old = machine("old");
  busy.readiness = fleet::Readiness::Occupied;
  small.height_mm = 20;
  coarse.pixel_mm = 0.1;
  other.light = "l2";
  announce(*queue, {busy, blue, small, coarse, other, old, machine("fits"), machine("drained")});
  ASSERT_TRUE(queue->drain("drained", true, "bo"));
  EXPECT_EQ(queue->drain("nobody", true, "bo").error().code, ErrorCode::NotFound);
  auto asks = job("vase");
  asks.needs = {"class-a", "l1", "grey", 50, 50, 50, 0.06, 0};
  ASSERT_TRUE(queue->submit(asks));
  for (const char* name : {"busy", "blue", "small", "coarse", "other", "drained"})
    EXPECT_FALSE(*queue->claim(name, 10s)) << name;
  announce(*queue, {busy, blue, small, coarse, other, machine("fits"), machine("drained")});
  EXPECT_FALSE(*queue->claim("drained", 10s)) << "what an administrator said stays";
  EXPECT_FALSE(*queue->claim("old", 10s)) << "it is not announced any more";
  EXPECT_TRUE(*queue->claim("fits", 10s));
}

TEST_P(FleetQueueTest, KeepsAMachineThatHasAJobThoughItsFabNoLongerNamesIt) {
  auto queue = open();
  announce(*queue, {machine("a1"), machine("a2")});
  ASSERT_TRUE(queue->submit(job("vase")));
  ASSERT_TRUE(*queue->claim("a1", 10s));
  announce(*queue, {});
  const auto left = queue->machines().value();
  ASSERT_THAT(left, SizeIs(1));
  EXPECT_EQ(left[0].name, "a1");
  EXPECT_EQ(queue->announce({"ny", "127.0.0.1:7421", "", "{}"}, std::vector{machine("a1")}).error().code,
            ErrorCode::Conflict);
  EXPECT_THAT(queue->fabs().value(), SizeIs(1)) << "nothing of a refused fab stays";
}

TEST_P(FleetQueueTest, TellsEventsInOrderAndOnceForEachKey) {
  auto queue = open();
  announce(*queue, {machine("a1")});
  ASSERT_TRUE(queue->submit(job("vase")));
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(queue->add_event("la-1", {0, 0, "vase", "a1", "layer 100"}));
    ASSERT_TRUE(queue->add_event("la-2", {0, 0, "vase", "a1", "layer 200"}));
  }
  const auto events = queue->events(0, 100).value();
  ASSERT_THAT(events, SizeIs(3));
  EXPECT_EQ(events[0].text, "submitted by ana");
  EXPECT_EQ(events[1].text, "layer 100");
  EXPECT_EQ(events[2].text, "layer 200");
  EXPECT_LT(events[0].number, events[1].number);
  EXPECT_THAT(queue->events(events[1].number, 100).value(), SizeIs(1));
  const auto newest = queue->newest_events(2).value();
  ASSERT_THAT(newest, SizeIs(2));
  EXPECT_EQ(newest[0].text, "layer 100");
}

TEST_P(FleetQueueTest, TreatsTextAsTextAndNeverAsAStatement) {
  auto queue = open();
  auto odd = job("odd");
  odd.name = "Gr\u00f6\u00dfe'); DROP TABLE lease; --? $1.ply";
  odd.owner = "\"ana\"\\";
  ASSERT_TRUE(queue->submit(odd));
  EXPECT_EQ(queue->find("odd")->name, odd.name);
  EXPECT_EQ(queue->find("odd")->owner, odd.owner);
  EXPECT_EQ(queue->find("' OR '1'='1").error().code, ErrorCode::NotFound);
}

TEST_P(FleetQueueTest, WakesWhoWaitsWhereAnotherChangesSomething) {
  auto waits = open(), other = open();
  (void)waits->wait(0s);  // what was before is no news
  EXPECT_FALSE(*waits->wait(30ms));
  ASSERT_TRUE(other->submit(job("vase")));
  EXPECT_TRUE(*waits->wait(5s));
}

TEST_P(FleetQueueTest, NeverGivesAJobOrAMachineTwiceHoweverManyClaimAtOnce) {
  constexpr int kMachines = 12, kJobs = 60;
  std::vector<Machine> machines;
  for (int i = 0; i < kMachines; ++i) machines.push_back(machine(fmt::format("m{:02}", i)));
  {
    auto queue = open();
    announce(*queue, machines);
    for (int i = 0; i < kJobs; ++i) ASSERT_TRUE(queue->submit(job(fmt::format("j{:02}", i), i % 3)));
  }
  std::mutex mutex;
  std::set<std::string> given;
  int twice = 0;
  std::vector<std::string> failures;
  {
    std::vector<std::jthread> fabs;
    for (int f = 0; f < 4; ++f)
      fabs.emplace_back([&, f] {
        auto queue = open();
        std::mt19937 random{static_cast<unsigned>(f)};
        for (int tries = 0; tries < 400; ++tries) {
          const std::string name = machines[random() % kMachines].name;  // any fab asks for any machine
          const auto lease = queue->claim(name, 10s);
          if (!lease && lease.error().code == ErrorCode::Conflict) continue;
          const std::lock_guard lock{mutex};
          if (!lease) failures.push_back(lease.error().what);
          if (!lease || !*lease) {
            if (given.size() == kJobs) return;
            continue;
          }
          twice += given.insert((*lease)->job).second ? 0 : 1;
          const auto ended = queue->finish((*lease)->job, (*lease)->attempt, State::Done, "");
          if (!ended || !*ended) failures.push_back(ended ? "lost a lease that it held" : ended.error().what);
        }
      });
  }
  EXPECT_THAT(failures, SizeIs(0)) << failures.front();
  EXPECT_EQ(twice, 0);
  EXPECT_EQ(given.size(), static_cast<std::size_t>(kJobs));
  auto queue = open();
  const std::vector done{State::Done};
  EXPECT_THAT(queue->jobs(done, 0, 1000).value(), SizeIs(kJobs));
}

/// The rules of a fleet once more, slowly and on their own: what a queue that answers may answer.
struct ModelJob {
  State state = State::Waiting;
  std::uint32_t attempt = 0;
  std::string machine;
  bool is_bound = false;
};

TEST_P(FleetQueueTest, AnswersAsTheModelDoesWhateverIsAsked) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    auto queue = open();
    std::mt19937 random{seed};
    const auto any = [&](std::size_t of) { return random() % of; };
    const std::vector<std::string> resins{"grey", "tough"};
    std::vector<Machine> machines;
    const std::string light = fmt::format("light-{}", seed);  // jobs of other rounds fit none of these machines
    for (int i = 0; i < 4; ++i) {
      machines.push_back(machine(fmt::format("s{}m{}", seed, i), resins[any(2)]));
      machines.back().light = light;
    }
    announce(*queue, machines, fmt::format("fab{}", seed));
    std::vector<fleet::Job> jobs;
    std::map<std::string, ModelJob> model;
    const auto holder = [&](const std::string& name) {
      return std::find_if(model.begin(), model.end(), [&](const auto& each) {
        return each.second.machine == name &&
               (each.second.state == State::Claimed || each.second.state == State::Bound);
      });
    };
    for (int step = 0; step < 150; ++step) {
      const std::string name = machines[any(4)].name;
      switch (any(6)) {
        case 0: {
          auto made = job(fmt::format("s{}j{}", seed, jobs.size()), static_cast<int>(any(3)));
          made.needs.light = light;
          if (any(2) == 0) made.needs.resin = resins[any(2)];
          const auto kept = queue->submit(made);
          ASSERT_TRUE(kept);
          jobs.push_back(kept->front());
          model[made.id] = {};
          break;
        }
        case 1: {
          const auto lease = queue->claim(name, 100s);
          if (holder(name) != model.end()) {
            EXPECT_EQ(lease.error().code, ErrorCode::Conflict);
            break;
          }
          ASSERT_TRUE(lease);
          const auto now = queue->now_unix_ms().value();
          std::vector<fleet::Job> waiting;
          for (fleet::Job each : jobs) {
            each.state = model[each.id].state;
            waiting.push_back(each);
          }
          const auto all = queue->machines().value();
          const auto it = std::find_if(all.begin(), all.end(), [&](const Machine& m) { return m.name == name; });
          ASSERT_NE(it, all.end());
          const auto wanted = fleet::place(waiting, {*it}, now);
          ASSERT_EQ(lease->has_value(), !wanted.empty());
          if (wanted.empty()) break;
          EXPECT_EQ((*lease)->job, wanted[0].job);
          ModelJob& own = model[(*lease)->job];
          own.state = State::Claimed, own.machine = name, own.is_bound = false;
          EXPECT_EQ((*lease)->attempt, ++own.attempt);
          break;
        }
        default: {
          if (jobs.empty()) break;
          const std::string id = jobs[any(jobs.size())].id;
          ModelJob& own = model[id];
          const std::uint32_t attempt = own.attempt - static_cast<std::uint32_t>(own.attempt > 0 && any(5) == 0);
          const bool holds = attempt == own.attempt && (own.state == State::Claimed || own.state == State::Bound);
          if (attempt == 0) break;
          switch (any(4)) {
            case 0:
              EXPECT_EQ(queue->renew(id, attempt, 100s)->has_value(), holds);
              break;
            case 1:
              ASSERT_EQ(queue->bind(id, attempt).value(), holds);
              if (holds) own.state = State::Bound, own.is_bound = true;
              break;
            case 2:
              ASSERT_EQ(queue->release(id, attempt, "").value(), holds && !own.is_bound);
              if (holds && !own.is_bound) own.state = State::Waiting;
              break;
            default:
              if (!holds && own.state == State::Done && attempt == own.attempt) break;  // told again
              ASSERT_EQ(queue->finish(id, attempt, State::Done, "").value(), holds);
              if (holds) own.state = State::Done;
          }
        }
      }
    }
    for (const fleet::Job& each : jobs) {
      const auto kept = queue->find(each.id).value();
      EXPECT_EQ(kept.state, model[each.id].state) << each.id;
      EXPECT_EQ(kept.attempt, model[each.id].attempt) << each.id;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Both, FleetQueueTest, testing::Values(Form::File, Form::Database), [](const auto& form) {
  return form.param == Form::File ? std::string{"File"} : std::string{"Database"};
});

TEST(FleetDatabase, GoesOnOnceItsServerWasKilledAndStartedAgainAndLosesNothing) {
  auto server = test::PostgresServer::start();
  if (!server) GTEST_SKIP() << "no PostgreSQL 15 server on this computer";
  auto queue = open_fleet_database(server->uri_of("fleet")).value();
  Machine m;
  m.name = "a1", m.profile = "class-a", m.pixel_mm = 0.05;
  ASSERT_TRUE(queue->announce({"la", "127.0.0.1:7420", "", "{}"}, std::vector{m}));
  std::mt19937 random{3};
  std::set<std::string> acknowledged;
  for (int kills = 0; kills < 3; ++kills) {
    const auto kill_behind = acknowledged.size() + random() % 20;
    // A session outlives its server by a moment, and what it acknowledges then holds like everything else.
    for (bool is_up = true; is_up;) {
      if (acknowledged.size() == kill_behind) server->kill();
      NewJob job;
      job.id = fmt::format("k{}j{}", kills, acknowledged.size());
      const auto kept = queue->submit(job);
      is_up = kept.has_value();
      if (kept) acknowledged.insert(job.id);
      if (!kept) {
        EXPECT_EQ(kept.error().code, ErrorCode::Unreachable) << kept.error().what;
        EXPECT_THAT(kept.error().what, HasSubstr("the fleet's database"));
      }
    }
    ASSERT_TRUE(server->run());
    Result<std::vector<fleet::Job>> all = fail(ErrorCode::Unreachable, "");
    for (int tries = 0; tries < 100 && !all; ++tries) {
      all = queue->jobs({}, 0, 10'000);
      if (!all) std::this_thread::sleep_for(50ms);
    }
    ASSERT_TRUE(all) << all.error().what;
    std::set<std::string> there;
    for (const fleet::Job& job : *all) there.insert(job.id);
    for (const std::string& id : acknowledged) EXPECT_TRUE(there.contains(id)) << id << " was acknowledged";
  }
  EXPECT_GT(acknowledged.size(), 20U);
}

TEST(FleetName, SaysWhatItIsAndHoldsNoPassword) {
  SystemClock clock;
  EXPECT_EQ(open_fleet("fleet.sqlite", clock).error().code, ErrorCode::InvalidInput);
  for (const char* uri : {"postgresql://fab:secret@db/fleet", "postgresql://db/fleet?password=secret",
                          "postgresql://db/fleet?pass%77ord=secret"}) {
    const auto refused = open_fleet(uri, clock);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
    EXPECT_THAT(refused.error().what, testing::AllOf(HasSubstr(".pgpass"), testing::Not(HasSubstr("secret"))));
  }
  const auto nobody = open_fleet("postgresql://fab@127.0.0.1:1/fleet", clock);
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error().code, ErrorCode::Unreachable);
  EXPECT_THAT(nobody.error().what, HasSubstr("127.0.0.1:1/fleet"));
}

TEST(FleetFile, OfANewerVersionOrOfAnotherProgramIsRefusedByName) {
  SystemClock clock;
  test::ScratchFolder scratch;
  const auto path = scratch.path() / "fleet.sqlite";
  ASSERT_TRUE(open_fleet_file(path, clock));
  EXPECT_TRUE(open_fleet("sqlite:" + path.string(), clock)) << "again, with its tables";
  ASSERT_EQ(std::system(fmt::format("printf 'not a database, but long enough to be looked at' > {}",
                                    (scratch.path() / "text").string())
                            .c_str()),
            0);
  const auto text = open_fleet_file(scratch.path() / "text", clock);
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().code, ErrorCode::NotTrusted);
}

}  // namespace
}  // namespace telefab
