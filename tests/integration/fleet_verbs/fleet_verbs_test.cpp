// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <telefab/store/fleet_queue.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>

// `telefab fleet` on a queue as fabs and scan sites fill it.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;

class FleetVerbs : public testing::Test {
 protected:
  void SetUp() override {
    std::vector<fleet::Machine> machines(2);
    for (std::size_t i = 0; i < machines.size(); ++i) {
      fleet::Machine& m = machines[i];
      m.name = "la-hall-" + std::to_string(i + 1);
      m.profile = "class-a", m.resin = i == 0 ? "grey" : "tough", m.pixel_mm = 0.05;
      m.width_mm = m.depth_mm = m.height_mm = 100;
    }
    ASSERT_TRUE(queue->announce({"la", "127.0.0.1:7420", "", "{}"}, machines));
    for (const char* id : {"vase", "cup"}) {
      fleet::NewJob job;
      job.id = id, job.name = std::string{id} + ".ply", job.owner = "ana", job.needs.resin = "grey";
      ASSERT_TRUE(queue->submit(job));
    }
  }
  Outcome fleet(std::vector<std::string> words) {
    std::vector<std::string> all{std::string{std::getenv("TELEFAB_BIN")} + "/telefab", "fleet"};
    all.insert(all.end(), words.begin(), words.end());
    all.insert(all.end(), {"--fleet", "sqlite:" + path.string(), "--who", "bo"});
    return run(all);
  }
  json listed(std::vector<std::string> words) {
    words.emplace_back("--json");
    const Outcome outcome = fleet(std::move(words));
    EXPECT_EQ(outcome.code, 0) << outcome.errors;
    return json::parse(outcome.output, nullptr, false);
  }

  ScratchFolder scratch;
  std::filesystem::path path = scratch.path() / "fleet.sqlite";
  SystemClock clock;
  std::unique_ptr<FleetQueue> queue = open_fleet_file(path, clock).value();
};

TEST_F(FleetVerbs, ListMachinesAndJobsAndSayOfEachMachineWhyItDoesNotPrintAJob) {
  EXPECT_THAT(fleet({"machines"}).output,
              testing::AllOf(HasSubstr("la-hall-1"), HasSubstr("free"), HasSubstr("tough")));
  const json jobs = listed({"jobs"});
  ASSERT_EQ(jobs.size(), 2U);
  EXPECT_EQ(jobs[0]["id"], "vase");
  EXPECT_EQ(jobs[0]["state"], "waiting");
  const json why = listed({"why", "cup"});
  ASSERT_EQ(why.size(), 2U) << "every machine";
  EXPECT_EQ(why[0]["why"], "later-in-order");
  EXPECT_EQ(why[1]["why"], "other-resin");
  EXPECT_EQ(why[1]["text"], "tough is loaded, not grey");
  const json planned = listed({"dry-run"});
  ASSERT_EQ(planned.size(), 1U);
  EXPECT_EQ(planned[0], json({{"job", "vase"}, {"machine", "la-hall-1"}}));
}

TEST_F(FleetVerbs, LetAnEarlierJobKeepALaterOneOffTheMachineThatItTakesAndOffNoOther) {
  std::vector<fleet::Machine> machines = queue->machines().value();
  for (fleet::Machine& m : machines) m.resin = "grey";
  ASSERT_TRUE(queue->announce({"la", "127.0.0.1:7420", "", "{}"}, machines));
  const json why = listed({"why", "cup"});
  ASSERT_EQ(why.size(), 2U);
  EXPECT_EQ(why[0]["why"], "later-in-order");
  EXPECT_EQ(why[1]["why"], "fits");
  const json planned = listed({"dry-run"});
  ASSERT_EQ(planned.size(), 2U);
  EXPECT_EQ(planned[1], json({{"job", "cup"}, {"machine", "la-hall-2"}}));
}

TEST(FleetVerbsAlone, MakeNoFleetOfAFileThatIsNotThere) {
  const ScratchFolder scratch;
  const std::filesystem::path path = scratch.path() / "mistyped.sqlite";
  const Outcome outcome = run(
      {std::string{std::getenv("TELEFAB_BIN")} + "/telefab", "fleet", "jobs", "--fleet", "sqlite:" + path.string()});
  EXPECT_NE(outcome.code, 0);
  EXPECT_THAT(outcome.errors, HasSubstr("no such file"));
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST_F(FleetVerbs, TakeAMachineOutOfServiceAndPutItBack) {
  EXPECT_EQ(fleet({"drain", "la-hall-1"}).code, 0);
  EXPECT_EQ(listed({"why", "vase"})[0]["why"], "draining");
  EXPECT_FALSE(*queue->claim("la-hall-1", 10s));
  EXPECT_EQ(fleet({"restore", "la-hall-1"}).code, 0);
  EXPECT_TRUE(*queue->claim("la-hall-1", 10s));
  const json events = listed({"events"});
  EXPECT_THAT(events.dump(),
              testing::AllOf(HasSubstr("taken out of service by bo"), HasSubstr("back in service by bo")));
}

TEST_F(FleetVerbs, CancelWhatIsNotLitAndDecideAboutWhatIsAndIsNotHeardOf) {
  ASSERT_TRUE(*queue->claim("la-hall-1", 1ms));
  ASSERT_TRUE(*queue->bind("vase", 1));
  EXPECT_EQ(fleet({"cancel", "vase"}).code, 2) << "it is cancelled at its fab";
  EXPECT_EQ(fleet({"decide", "vase", "--as", "waiting"}).code, 2) << "its fab is heard of";
  clock.sleep_for(10ms);
  ASSERT_EQ(queue->expire().value(), 1U);
  EXPECT_EQ(fleet({"decide", "vase"}).code, 2) << "as what";
  EXPECT_EQ(listed({"decide", "vase", "--as", "waiting"})["state"], "waiting");
  EXPECT_EQ(listed({"cancel", "cup"})["state"], "cancelled");
  EXPECT_EQ(listed({"jobs"}).size(), 1U);
  EXPECT_EQ(listed({"jobs", "--all"}).size(), 2U);
}

TEST_F(FleetVerbs, NameWhatIsWrongAndWhatToDo) {
  const Outcome nobody = fleet({"why", "bowl"});
  EXPECT_EQ(nobody.code, 7);
  EXPECT_THAT(nobody.errors, HasSubstr("no job bowl in the fleet"));
  EXPECT_THAT(fleet({"drain"}).errors, HasSubstr("needs the NAME of a machine"));
  const Outcome away = run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab", "fleet", "--fleet",
                            "postgresql://nobody@127.0.0.1:1/fleet"});
  EXPECT_NE(away.code, 0);
  EXPECT_THAT(away.errors, HasSubstr("127.0.0.1:1/fleet does not answer"));
  EXPECT_THAT(run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab", "fleet", "--fleet", "fleet.sqlite"}).errors,
              HasSubstr("sqlite:PATH"));
}

}  // namespace
}  // namespace telefab::test
