// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>

#include <algorithm>
#include <fstream>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/store/fleet_queue.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/test/postgres_server.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/test/toy.hpp>

// Fabs and scan sites of a fleet as real processes, killed at the worst moments: every job is printed once, by one fab.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using fleet::State;
using testing::HasSubstr;
namespace fs = std::filesystem;

class Fleet : public testing::Test {
 protected:
  Fleet() : bin_{::getenv("TELEFAB_BIN") ? ::getenv("TELEFAB_BIN") : "."} {
    fs::create_directories(folder() / "machines");
    set_machine(200);
    write_torus(folder() / "torus.xyz", 90, 36);
  }
  ~Fleet() override {
    sites_.clear();
    std::error_code error;
    for (int tries = 0; tries < 200 && (tries == 0 || error); ++tries) {
      fs::remove_all(folder(), error);  // what computes the accuracy outlives a fab that was killed
      if (error) ::poll(nullptr, 0, 50);
    }
  }

  [[nodiscard]] const fs::path& folder() const { return scratch_.path(); }
  void set_machine(double speed_up) const {
    std::ofstream{folder() / "machines" / "toy.toml"} << kToyProfile
                                                      << fmt::format(
                                                             "[resin]\ncritical_dose_mj_per_cm2 = 4.0\npenetration_mm "
                                                             "= 0.3\n[devices]\nspeed_up = {:.1f}\n",
                                                             speed_up);
  }
  void use(const std::string& queue) { queue_name_ = queue; }

  /// "telefab-fab" or "telefab-scan", of a name of its own in the fleet; its port is kept over restarts.
  void start(const std::string& program, const std::string& name, std::vector<std::string> more = {}) {
    std::vector<std::string> command{bin_ + "/" + program,
                                     "serve",
                                     "--listen",
                                     site(name),
                                     "--data",
                                     (folder() / name).string(),
                                     "--machines",
                                     (folder() / "machines").string(),
                                     "--fleet",
                                     queue_name_,
                                     "--fleet-name",
                                     name};
    command.insert(command.end(), more.begin(), more.end());
    sites_[name] = std::make_unique<Process>(command);
    ports_[name] = sites_[name]->read_line();
    ASSERT_FALSE(ports_[name].empty()) << sites_[name]->errors();
  }
  void start_fab(const std::string& name, const std::vector<std::string>& more = {}) {
    start("telefab-fab", name, more);
  }
  void start_scan(const std::string& name) { start("telefab-scan", name); }
  void kill(const std::string& name) { sites_.erase(name); }
  [[nodiscard]] std::string site(const std::string& name) const {
    const auto port = ports_.find(name);
    return "127.0.0.1:" + (port == ports_.end() ? "0" : port->second);
  }

  [[nodiscard]] Outcome telefab(std::vector<std::string> words, const std::string& at) const {
    words.insert(words.begin(), bin_ + "/telefab");
    words.insert(words.end(), {"--site", site(at)});
    return run(words);
  }
  [[nodiscard]] std::string submit(const std::string& at, const std::string& machine = "toy",
                                   const std::vector<std::string>& more = {}) {
    // The profiles of the fleet are known a moment after the start.
    Outcome outcome;
    for (int tries = 0; tries < 100; ++tries) {
      std::vector<std::string> words{"submit", (folder() / "torus.xyz").string(), "--machine", machine, "--height-mm",
                                     "4"};
      words.insert(words.end(), more.begin(), more.end());
      outcome = telefab(words, at);
      if (outcome.code == 0) break;
      ::poll(nullptr, 0, 100);
    }
    EXPECT_EQ(outcome.code, 0) << outcome.errors;
    return outcome.output.substr(0, outcome.output.find('\n'));
  }

  [[nodiscard]] FleetQueue& queue() {
    for (int tries = 0; !queue_ && tries < 100; ++tries) {
      auto opened = open_fleet(queue_name_, clock_);
      if (opened)
        queue_ = std::move(*opened);
      else
        ::poll(nullptr, 0, 100);
    }
    return *queue_;
  }
  /// An empty one where it is not submitted yet.
  [[nodiscard]] fleet::Job in_fleet(const std::string& job) { return queue().find(job).value_or(fleet::Job{}); }
  [[nodiscard]] bool waits_in_fleet(const std::string& job) {
    const fleet::Job now = in_fleet(job);
    return now.id == job && now.state == State::Waiting;
  }
  /// As a site has it; an empty one where it does not.
  [[nodiscard]] Job at(const std::string& name, const std::string& job) const {
    const auto store = JobStore::open(folder() / name / "jobs.sqlite", clock_);
    return store ? (*store)->find(job).value_or(Job{}) : Job{};
  }
  template <class Condition>
  [[nodiscard]] static bool await(const Condition& condition, std::chrono::seconds longest = 60s) {
    for (const auto end = std::chrono::steady_clock::now() + longest; std::chrono::steady_clock::now() < end;
         ::poll(nullptr, 0, 50))
      if (condition()) return true;
    return condition();
  }
  /// How often layers of a job were announced to be lit, under whatever attempt, at the fabs of those names.
  [[nodiscard]] std::map<std::uint32_t, int> lit(const std::string& job, const std::vector<std::string>& fabs) const {
    std::map<std::uint32_t, int> times;
    for (const std::string& fab : fabs)
      for (const auto& entry : fs::directory_iterator{folder() / fab / "jobs"}) {
        const std::string id = entry.path().filename().string();
        if (id != job && !id.starts_with(job + "-a")) continue;
        const fs::path copy = folder() / "journal";  // the fab may be writing it
        std::error_code none;
        if (!fs::copy_file(entry.path() / "journal", copy, fs::copy_options::overwrite_existing, none)) continue;
        auto file = fab::open_journal_file(copy);
        const auto journal = fab::PrintJournal::open(std::move(*file));
        for (const fab::JournalEntry& each : journal->entries())
          if (each.step == fab::JournalStep::Exposing) ++times[each.layer.count()];
      }
    return times;
  }
  /// That every layer was lit, and once.
  void expect_printed_once(const std::string& job, const std::vector<std::string>& fabs) const {
    const auto times = lit(job, fabs);
    EXPECT_GE(times.size(), 20U) << job;
    for (const auto& [layer, count] : times) EXPECT_EQ(count, 1) << job << " layer " << layer;
  }

  ScratchFolder scratch_;
  std::string bin_;
  SystemClock clock_;
  std::string queue_name_ = "sqlite:" + (scratch_.path() / "fleet.sqlite").string();
  std::unique_ptr<FleetQueue> queue_;
  std::map<std::string, std::string> ports_;
  std::map<std::string, std::unique_ptr<Process>> sites_;
};

TEST_F(Fleet, PrintsTheJobsOfTwoScanSitesOnTheMachinesOfTwoFabsEachOnce) {
  for (const char* fab : {"la", "sf"}) start_fab(fab);
  for (const char* scan : {"chicago", "boston"}) start_scan(scan);
  std::map<std::string, std::string> jobs;
  for (int i = 0; i < 6; ++i) {
    const std::string at = i % 2 ? "boston" : "chicago";
    jobs[submit(at)] = at;
  }
  ASSERT_EQ(jobs.size(), 6U);
  std::set<std::string> machines;
  for (const auto& [job, scan] : jobs) {
    ASSERT_TRUE(await([&] { return at(scan, job).state == JobState::Done; })) << at(scan, job).message;
    ASSERT_TRUE(await([&] { return in_fleet(job).state == State::Done; })) << in_fleet(job).message;
    expect_printed_once(job, {"la", "sf"});
    machines.insert(in_fleet(job).machine);
    EXPECT_EQ(at(scan, job).instance, in_fleet(job).machine);
    EXPECT_EQ(in_fleet(job).site, scan);
    EXPECT_TRUE(job.starts_with(scan + "-")) << job;
    EXPECT_TRUE(fs::exists(folder() / scan / "jobs" / job / "report" / "as-built.json")) << "reports come from its fab";
  }
  EXPECT_THAT(machines, testing::ElementsAre("la-toy", "sf-toy")) << "no machine stands idle while jobs wait";
}

TEST_F(Fleet, HasAnotherFabPrintWhatOneLostBeforeItsFirstLightAndAsksAboutWhatWasLit) {
  const std::vector<std::string> goes_on{"--after-crash", "treat-as-exposed"};
  start_fab("ny", {"--start", "on-approval"});
  start_scan("chicago");
  const std::string dark = submit("chicago");
  ASSERT_TRUE(await([&] { return at("ny", dark).state == JobState::AwaitingApproval; })) << at("chicago", dark).message;
  set_machine(8);  // the next fab prints slowly
  start_fab("la", goes_on);
  const std::string begun = submit("chicago", "la-toy");
  ASSERT_TRUE(await([&] { return in_fleet(begun).state == State::Bound && lit(begun, {"la"}).size() > 2; }))
      << at("chicago", begun).message;
  kill("la");
  kill("ny");
  start_fab("sf");
  // Of the one nothing was lit: another fab has it, under the next attempt.
  ASSERT_TRUE(await([&] { return at("chicago", dark).state == JobState::Done; }, 120s)) << at("chicago", dark).message;
  EXPECT_EQ(in_fleet(dark).machine, "sf-toy");
  EXPECT_EQ(in_fleet(dark).attempt, 2U);
  EXPECT_EQ(at("sf", dark + "-a2").state, JobState::Done);
  // Of the other something was: it is nobody else's, and whoever looks is told.
  ASSERT_TRUE(await([&] { return in_fleet(begun).state == State::Asking; })) << in_fleet(begun).message;
  ASSERT_TRUE(await([&] { return at("chicago", begun).message.find("decide") != std::string::npos; }));
  EXPECT_EQ(at("chicago", begun).state, JobState::Printing);
  // Both come back: what was given away is not lit there, what was lit there goes on.
  start_fab("ny", {"--start", "on-approval"});
  set_machine(200);
  start_fab("la", goes_on);
  ASSERT_TRUE(await([&] { return at("ny", dark).state == JobState::Cancelled; })) << at("ny", dark).message;
  EXPECT_NE(telefab({"approve", dark}, "ny").code, 0);
  ASSERT_TRUE(await([&] { return at("chicago", begun).state == JobState::Done; })) << at("la", begun).message;
  ASSERT_TRUE(await([&] { return in_fleet(begun).state == State::Done; })) << in_fleet(begun).message;
  EXPECT_EQ(in_fleet(begun).attempt, 1U);
  expect_printed_once(dark, {"ny", "la", "sf"});
  expect_printed_once(begun, {"ny", "la", "sf"});
}

TEST_F(Fleet, PrintsCopiesOnWhateverMachineIsFreeAndWhatIsMoreUrgentFirst) {
  start_scan("chicago");
  start_fab("la");
  ASSERT_TRUE(await([&] { return !queue().machines().value().empty(); }));
  kill("la");  // so that all of them wait
  const std::string usual = submit("chicago");
  const std::string gear =
      submit("chicago", "toy", {"--copies", "3", "--priority", "5", "--deadline", "2099-03-01T08:00Z"});
  const std::vector<std::string> copies{gear, gear + "-c2", gear + "-c3"};
  for (const std::string& job : copies) {
    ASSERT_TRUE(await([&] { return waits_in_fleet(job); })) << at("chicago", job).message;
    EXPECT_EQ(in_fleet(job).priority, 5);
    EXPECT_EQ(in_fleet(job).deadline_unix_ms, 4'076'035'200'000);
    EXPECT_EQ(in_fleet(job).stack_key, in_fleet(gear).stack_key);
  }
  ASSERT_TRUE(await([&] { return waits_in_fleet(usual); }));
  start_fab("la");
  start_fab("sf");
  for (const std::string& job : copies) {
    ASSERT_TRUE(await([&] { return at("chicago", job).state == JobState::Done; })) << at("chicago", job).message;
    expect_printed_once(job, {"la", "sf"});
  }
  ASSERT_TRUE(await([&] { return at("chicago", usual).state == JobState::Done; })) << at("chicago", usual).message;
  std::vector<std::string> order;
  const auto events = queue().events(0, 1000).value();
  for (const fleet::Event& event : events)
    if (event.text.starts_with("attempt ")) order.push_back(event.job);
  ASSERT_FALSE(order.empty());
  EXPECT_EQ(order.back(), usual) << fmt::format("{}", fmt::join(order, ", "));
  const Outcome refused =
      telefab({"submit", (folder() / "torus.xyz").string(), "--machine", "toy", "--deadline", "tomorrow"}, "chicago");
  EXPECT_NE(refused.code, 0);
  EXPECT_THAT(refused.errors, HasSubstr("2027-03-01T08:00Z"));
}

TEST_F(Fleet, KeepsAJobThatAFabDoesNotTakeForWantOfItsKeyAndSaysSo) {
  fs::create_directories(folder() / "no keys");
  start_fab("la", {"--site-keys", (folder() / "no keys").string()});
  start_scan("chicago");
  const std::string job = submit("chicago");
  ASSERT_TRUE(await([&] {
    return at("chicago", job).message.find("the fab la does not take it") != std::string::npos;
  })) << at("chicago", job).message;
  EXPECT_EQ(at("chicago", job).state, JobState::Sending) << "another fab may know it";
  EXPECT_EQ(telefab({"cancel", job}, "chicago").code, 0);
  EXPECT_TRUE(await([&] { return in_fleet(job).state == State::Cancelled; }));
}

TEST_F(Fleet, CancelsAtTheScanSiteWhatWaitsAndWhatPrints) {
  set_machine(4);
  start_fab("la");
  start_scan("chicago");
  const std::string begun = submit("chicago");
  ASSERT_TRUE(await([&] { return in_fleet(begun).state == State::Bound; })) << at("chicago", begun).message;
  const std::string waits = submit("chicago");
  ASSERT_TRUE(await([&] { return waits_in_fleet(waits); }));
  EXPECT_EQ(telefab({"cancel", waits}, "chicago").code, 0);
  EXPECT_TRUE(await([&] { return in_fleet(waits).state == State::Cancelled; }));
  EXPECT_EQ(telefab({"cancel", begun}, "chicago").code, 0);
  EXPECT_TRUE(await([&] { return at("la", begun).state == JobState::Cancelled; })) << at("la", begun).message;
  EXPECT_TRUE(await([&] { return in_fleet(begun).state == State::Cancelled; })) << in_fleet(begun).message;
  // What somebody cancels in the queue ends at the scan site too.
  kill("la");
  const std::string other = submit("chicago");
  ASSERT_TRUE(await([&] { return waits_in_fleet(other); })) << at("chicago", other).message;
  ASSERT_TRUE(queue().cancel(other, "ana"));
  EXPECT_TRUE(await([&] { return at("chicago", other).state == JobState::Cancelled; })) << at("chicago", other).message;
  EXPECT_THAT(at("chicago", other).message, HasSubstr("ana"));
}

TEST_F(Fleet, GoesOnWithAPrintWhileTheDatabaseIsAwayAndTellsItsEndLater) {
  const auto server = PostgresServer::start();
  if (!server) GTEST_SKIP() << "no PostgreSQL 15 server on this computer";
  use(server->uri_of("fleet"));
  set_machine(20);
  start_fab("la");
  start_scan("chicago");
  const std::string job = submit("chicago");
  ASSERT_TRUE(await([&] { return in_fleet(job).state == State::Bound && !lit(job, {"la"}).empty(); }))
      << at("chicago", job).message;
  queue_.reset();
  server->kill();
  ASSERT_TRUE(await([&] { return at("la", job).state == JobState::Done; })) << at("la", job).message;
  ASSERT_TRUE(await([&] { return at("chicago", job).state == JobState::Done; })) << at("chicago", job).message;
  const std::string next = submit("chicago");
  ASSERT_TRUE(await([&] { return at("chicago", next).message.find("queue of the fleet") != std::string::npos; }))
      << at("chicago", next).message;
  ASSERT_TRUE(server->run());
  EXPECT_TRUE(await([&] { return in_fleet(job).state == State::Done; })) << in_fleet(job).message;
  EXPECT_TRUE(await([&] { return at("chicago", next).state == JobState::Done; }, 120s)) << at("chicago", next).message;
  for (const std::string& each : {job, next}) expect_printed_once(each, {"la"});
}

}  // namespace
}  // namespace telefab::test
