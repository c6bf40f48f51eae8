// SPDX-License-Identifier: GPL-3.0-or-later
#include <signal.h>

#include <sqlite3.h>
#include <set>
#include <telefab/base/clock.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/test/several_machines.hpp>

// One fab, several machines: who prints what, what one machine's trouble means to the others, and what of it is kept
// over a restart.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

class Machines : public SeveralMachines {
 protected:
  /// Everything between the first and the last light of a print.
  [[nodiscard]] std::pair<std::int64_t, std::int64_t> lit(const std::string& job) const {
    const Json record = record_of(job);
    const Json& layers = record["layers"];
    return {layers.front()["started_wall_ns"], layers.back()["started_wall_ns"]};
  }
  void expect_whole(const std::string& job) const {
    const Outcome verified = run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab-fab", "verify",
                                  (job_folder(job) / "plan").string(), "--machines", (folder() / "machines").string(),
                                  "--as-built", (job_folder(job) / "report" / "as-built.json").string()});
    EXPECT_EQ(verified.code, 0) << verified.output << verified.errors;
  }
  void expect_done(const std::string& job) const {
    EXPECT_TRUE(await([&] { return job_state(job) == "done"; })) << says();
  }
};

TEST_F(Machines, OfOneProfilePrintAtTheSameTimeAndEachPrintIsNamedByItsMachine) {
  set_machine(20);
  write_list({"a", "b", "c"});
  start_sites();
  const std::vector<std::string> jobs{submit_for("toy"), submit_for("toy"), submit_for("c")};
  ASSERT_TRUE(await([&] {
    return state_of("a") == "printing" && state_of("b") == "printing" && state_of("c") == "printing";
  })) << says();
  EXPECT_THAT(telefab({"machines"}).output, HasSubstr("printing  " + jobs[0])) << "at the scan site too";
  for (const std::string& job : jobs) expect_done(job);
  std::set<std::string> machines;
  for (const std::string& job : jobs) {
    expect_whole(job);
    const std::string machine = record_of(job)["provenance"]["instance"];
    EXPECT_EQ(job_of(job)["instance"], machine);
    EXPECT_EQ(job_of(job)["machine"], job == jobs[2] ? "c" : "toy");
    EXPECT_THAT(telefab({"status", job}).output, HasSubstr(machine)) << "at the scan site";
    machines.insert(machine);
  }
  EXPECT_EQ(machines.size(), 3U);
  EXPECT_EQ(record_of(jobs[0])["provenance"]["instance"], "a") << "the first of the list that is free";
  std::int64_t last_begin = 0, first_end = INT64_MAX;
  for (const std::string& job : jobs) {
    last_begin = std::max(last_begin, lit(job).first);
    first_end = std::min(first_end, lit(job).second);
  }
  EXPECT_LT(last_begin, first_end) << "all three were lit before one had ended";
}

TEST_F(Machines, PrintAJobOfTheirProfileWithTheirOwnDevices) {
  std::ofstream{folder() / "machines" / "toy.toml", std::ios::app}
      << "stage = \"grbl\"\nstage_serial = \"of no machine here\"\n";
  write_list({"a", "b"}, {{"b", "[machine.devices]\nstage = \"virtual\"\nspeed_up = 2000.0\n"}});
  start_sites({"--platform", "automatic"});
  const std::string there = submit_for("b", "2"), of_profile = submit_for("toy", "2");
  expect_done(there);
  expect_done(of_profile);
  EXPECT_EQ(record_of(of_profile)["provenance"]["instance"], "b") << "the stage of a is not found";
}

TEST_F(Machines, TakeAJobOfTheirProfileAsSoonAsOneIsFree) {
  set_machine(40);
  write_list({"a", "b"});
  start_sites();
  std::vector<std::string> jobs;
  for (int i = 0; i < 5; ++i) jobs.push_back(submit_for("toy", "2"));
  const std::string own = submit_for("a", "2");
  for (const std::string& job : jobs) expect_done(job);
  expect_done(own);
  std::map<std::string, int> printed;
  for (const std::string& job : jobs) ++printed[record_of(job)["provenance"]["instance"]];
  EXPECT_GT(printed["a"], 0);
  EXPECT_GT(printed["b"], 0);
  EXPECT_EQ(record_of(own)["provenance"]["instance"], "a");
}

TEST_F(Machines, ArePausedResumedAndCancelledOneByOne) {
  set_machine(40);
  write_list({"a", "b", "c"});
  start_sites();
  const std::string paused = submit_for("a"), cancelled = submit_for("b"), free = submit_for("c");
  ASSERT_TRUE(await([&] { return lights(paused) > 1 && lights(cancelled) > 1; })) << says();
  ASSERT_EQ(at_fab({"pause", paused, "--who", "ana"}).code, 0);
  ASSERT_EQ(at_fab({"cancel", cancelled, "--who", "ana"}).code, 0);
  ASSERT_TRUE(await([&] { return state_of("a") == "paused" && state_of("b") == "idle"; })) << says();
  const std::string next = submit_for("toy", "2");
  expect_done(free);
  expect_done(next);
  EXPECT_NE(record_of(next)["provenance"]["instance"], "a") << "a part hangs there";
  EXPECT_EQ(job_state(paused), "paused");
  const std::string behind = submit_for("a", "2");
  EXPECT_TRUE(await(
      [&] { return at_fab({"jobs"}).output.find("waits for a") != std::string::npos || state_of("a") == "paused"; }));
  ASSERT_EQ(at_fab({"resume", paused, "--who", "ana"}).code, 0);
  expect_done(paused);
  expect_done(behind);
  expect_whole(paused);
}

TEST_F(Machines, WhosePlatformWasClearedAreNotOccupiedAgainAfterARestart) {
  // Begun before the machine had a name of its own, so that its platform is kept under that of its profile.
  set_machine(5000);
  start_fab({"--platform", "cleared-by-operator"});
  start_scan();
  const std::string job = submit_for("toy", "2");
  expect_done(job);
  kill_fab();
  write_list({"a"});
  start_fab(with_list({"--platform", "cleared-by-operator"}));
  EXPECT_EQ(state_of("a"), "occupied");
  EXPECT_EQ(at_fab({"cleared", "a", "--who", "ana"}).code, 0) << says();
  EXPECT_EQ(state_of("a"), "idle");
  kill_fab();
  start_fab(with_list({"--platform", "cleared-by-operator"}));
  EXPECT_EQ(state_of("a"), "idle") << says();
}

TEST_F(Machines, WaitEachForItsOwnPlatform) {
  set_machine(5000);
  write_list({"a", "b"});
  start_sites({"--platform", "cleared-by-operator"});
  const std::string first = submit_for("toy", "2"), second = submit_for("toy", "2");
  expect_done(first);
  expect_done(second);
  EXPECT_EQ(state_of("a"), "occupied");
  EXPECT_EQ(state_of("b"), "occupied");
  const std::string third = submit_for("toy", "2");
  ASSERT_TRUE(await([&] { return at_fab({"jobs"}).output.find("telefab cleared a") != std::string::npos; })) << says();
  EXPECT_EQ(at_fab({"cleared", "toy"}).code, 2) << "a profile has no platform";
  EXPECT_EQ(at_fab({"cleared", "b", "--who", "ana"}).code, 0);
  expect_done(third);
  EXPECT_EQ(record_of(third)["provenance"]["instance"], "b") << "any machine of its profile";
  EXPECT_EQ(state_of("a"), "occupied");
}

TEST_F(Machines, GoOnEachWithItsOwnPrintAfterAKill) {
  set_machine(20);
  write_list({"a", "b", "c"});
  start_sites({"--after-crash", "treat-as-exposed"});
  const std::vector<std::string> jobs{submit_for("toy"), submit_for("toy"), submit_for("toy")};
  ASSERT_TRUE(await([&] { return lights(jobs[0]) > 2 && lights(jobs[1]) > 2 && lights(jobs[2]) > 2; })) << says();
  std::map<std::string, std::string> at;
  for (const std::string& job : jobs) at[job] = job_of(job)["instance"];
  kill_fab();
  std::map<std::string, std::size_t> before;
  for (const std::string& job : jobs) before[job] = lights(job);
  start_fab(with_list({"--after-crash", "treat-as-exposed"}));
  for (const std::string& job : jobs) {
    expect_done(job);
    EXPECT_GT(lights(job), before[job]);
    EXPECT_EQ(record_of(job)["provenance"]["instance"], at[job]) << "the part hangs there";
    expect_whole(job);
    std::set<int> layers;
    const Json record = record_of(job);
    for (const Json& layer : record["layers"])
      EXPECT_TRUE(layers.insert(layer["layer"].get<int>()).second) << "no layer twice";
    EXPECT_EQ(*layers.rbegin() + 1, static_cast<int>(layers.size())) << "none is missing";
  }
}

TEST_F(Machines, FinishWhatTheyBeganAfterAKillBeforeAnOlderJobThatWaits) {
  set_machine(40);
  write_list({"a", "b"});
  const auto options = with_list({"--start", "on-approval", "--after-crash", "treat-as-exposed"});
  start_sites({"--start", "on-approval"});
  const std::string older = submit_for("a", "2"), begun = submit_for("a");
  ASSERT_TRUE(await([&] { return job_state(older) == "awaiting-approval" && job_state(begun) == "awaiting-approval"; }))
      << says();
  ASSERT_EQ(at_fab({"approve", begun, "--who", "ana"}).code, 0) << says();
  ASSERT_TRUE(await([&] { return lights(begun) > 2; })) << says();
  ASSERT_EQ(at_fab({"approve", older, "--who", "ana"}).code, 0) << says();
  kill_fab();
  ASSERT_EQ(lights(older), 0U);
  start_fab(options);
  expect_done(begun);
  expect_done(older);
  EXPECT_LT(lit(begun).second, lit(older).first) << "a part hung there";
}

TEST_F(Machines, ThatGotTheNameOfOneThatHoldsAPrintDoNotGoOnWithIt) {
  set_machine(40);
  write_list({"a", "b"});
  start_sites();
  const std::string job = submit_for("toy");
  ASSERT_TRUE(await([&] { return lights(job) > 2; })) << says();
  fab().send_signal(SIGTERM);
  ASSERT_EQ(fab().finish(), 0);
  const std::size_t before = lights(job);
  std::ofstream{folder() / "machines" / "other.toml"} << "name = \"other\"\ninherits = \"toy\"\n";
  std::ofstream{folder() / "fab.toml"} << "[[machine]]\nname = \"a\"\nprofile = \"other\"\n"
                                          "[[machine]]\nname = \"b\"\nprofile = \"toy\"\n";
  start_fab(with_list());
  EXPECT_EQ(job_state(job), "paused");
  EXPECT_THAT(at_fab({"jobs"}).output, HasSubstr("the machine of that name is of other now"));
  EXPECT_EQ(at_fab({"resume", job, "--who", "ana"}).code, 2);
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(lights(job), before);
  EXPECT_EQ(at_fab({"cancel", job, "--who", "ana"}).code, 0);
}

TEST_F(Machines, ThatWereTakenOutOfTheListLeaveTheirPrintDarkAndAskedAbout) {
  set_machine(40);
  write_list({"a", "b"});
  start_sites();
  const std::string job = submit_for("b"), waiting = submit_for("b", "2");
  ASSERT_TRUE(await([&] { return lights(job) > 2; })) << says();
  ASSERT_TRUE(await([&] { return job_state(waiting) == "ready"; })) << says();
  fab().send_signal(SIGTERM);
  ASSERT_EQ(fab().finish(), 0);
  const std::size_t before = lights(job);
  write_list({"a"});
  start_fab(with_list());
  EXPECT_EQ(job_state(job), "paused");
  EXPECT_THAT(at_fab({"jobs"}).output, HasSubstr("its print began on b, which does not stand in this fab any more"));
  const Outcome resumed = at_fab({"resume", job, "--who", "ana"});
  EXPECT_EQ(resumed.code, 2) << resumed.errors;
  EXPECT_THAT(resumed.errors, HasSubstr("name it again in the list of machines"));
  EXPECT_THAT(at_fab({"jobs"}).output, HasSubstr("no machine named b"));
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(lights(job), before);
  kill_fab();
  write_list({"a", "b"});
  start_fab(with_list());
  // It waits for a word: at the start before nobody could have let it go on.
  ASSERT_EQ(at_fab({"resume", job, "--who", "ana"}).code, 0) << says();
  ASSERT_EQ(at_fab({"resume", waiting, "--who", "ana"}).code, 0) << says();
  expect_done(job);
  expect_done(waiting);
  EXPECT_EQ(record_of(job)["provenance"]["instance"], "b");
}

TEST_F(Machines, TakeOverAFolderOfAFabThatHadOneMachineAProfile) {
  set_machine(40);
  start_fab();
  start_scan();
  const std::string job = submit_for("toy");
  ASSERT_TRUE(await([&] { return lights(job) > 2; })) << says();
  fab().send_signal(SIGTERM);
  ASSERT_EQ(fab().finish(), 0);
  // As an earlier release left it.
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((folder() / "fab" / "jobs.sqlite").c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "ALTER TABLE job DROP COLUMN instance; PRAGMA user_version = 3;", nullptr, nullptr,
                         nullptr),
            SQLITE_OK);
  sqlite3_close(database);
  write_list({"hall-1"});
  start_fab(with_list());
  expect_done(job);
  EXPECT_EQ(record_of(job)["provenance"]["instance"], "hall-1") << "the only machine of the profile";
  expect_whole(job);
}

TEST_F(Machines, OfAFabWithoutAListAreOneOfEachProfile) {
  start_fab();
  start_scan();
  const std::string job = submit_for("toy", "2");
  expect_done(job);
  EXPECT_EQ(record_of(job)["provenance"]["instance"], "toy");
  const Json status = status_of("toy");
  EXPECT_EQ(status["state"], "idle");
  EXPECT_EQ(status["profile"], "toy");
  EXPECT_EQ(status["stated"], false);
}

TEST_F(Machines, ThatMayHaveOneDeviceAreRefusedByName) {
  const auto refused = [&](const std::string& a, const std::string& b) {
    write_list({"a", "b"}, {{"a", a}, {"b", b}});
    const Outcome outcome = run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab-fab", "serve", "--listen",
                                 "127.0.0.1:0", "--data", (folder() / "refused").string(), "--machines",
                                 (folder() / "machines").string(), "--instances", (folder() / "fab.toml").string()});
    EXPECT_EQ(outcome.code, 2) << outcome.errors;
    return outcome.errors;
  };
  const std::string grbl = "[machine.devices]\nspeed_up = 1.0\nstage = \"grbl\"\nstage_serial = \"G1\"";
  const std::string marlin = "[machine.devices]\nspeed_up = 1.0\nstage = \"marlin\"\nstage_serial = \"G1\"";
  const std::string any = "[machine.devices]\nspeed_up = 1.0\nstage = \"grbl\"";
  EXPECT_THAT(refused(grbl, marlin), AllOf(HasSubstr("machines a and b may have one stage (G1 and G1)"),
                                           HasSubstr("state devices.stage_serial of each")));
  EXPECT_THAT(refused(grbl, any), HasSubstr("(G1 and whichever is found)"));
  EXPECT_THAT(refused("resin = \"tar\"", ""), AllOf(HasSubstr("fab.toml, line 4"), HasSubstr("no resin named tar")));
}

TEST_F(Machines, AreRefusedWhereTheListIsNotThere) {
  const Outcome outcome = run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab-fab", "serve", "--listen",
                               "127.0.0.1:0", "--data", (folder() / "refused").string(), "--machines",
                               (folder() / "machines").string(), "--instances", "/no/where"});
  EXPECT_NE(outcome.code, 0);
  EXPECT_THAT(outcome.errors, AllOf(HasSubstr("--instances"), HasSubstr("/no/where")));
}

}  // namespace
}  // namespace telefab::test
