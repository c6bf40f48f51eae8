// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <iostream>
#include <random>
#include <set>
#include <telefab/test/http_client.hpp>

#include "whole_printers.hpp"

// A printer that owns its light as a machine of the fab: scan site, fab and a strict simulated printer as real
// programs. TELEFAB_WHOLE_KILLS says how often the fab is killed in a campaign (default: 6).

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

TEST_F(WholePrinters, PrintAJobOfTheScanSiteAndItsRecordSaysWhoseLightItWas) {
  start_printer();
  write_whole_list();
  start_sites();
  const std::string job = submit_for("toy", "2");
  await_state(job, "done");
  EXPECT_EQ(job_of(job)["instance"], "saturn");
  const Json record = record_of(job);
  EXPECT_EQ(record["light"], "by the printer");
  EXPECT_EQ(record["end"], "done");
  EXPECT_EQ(record["job"], job);
  EXPECT_EQ(record["provenance"]["instance"], "saturn");
  EXPECT_EQ(record["orders"][0]["by"], "automatic");
  const Outcome verified =
      run({bin("telefab-fab"), "verify", (job_folder(job) / "plan").string(), "--machines",
           (folder() / "machines").string(), "--as-built", (job_folder(job) / "report" / "as-built.json").string(),
           "--key", (folder() / "fab" / "as-built-key.pub").string()});
  EXPECT_EQ(verified.code, 0) << verified.output << verified.errors;
  EXPECT_THAT(verified.output, HasSubstr("by the printer"));
  EXPECT_EQ(state_of("saturn"), "occupied") << "a part hangs there";
  const std::string next = submit_for("toy", "1");
  ASSERT_TRUE(await([&] { return message_of(next).find("telefab cleared saturn") != std::string::npos; })) << says();
  EXPECT_EQ(at_fab({"cleared", "saturn"}).code, 0);
  await_state(next, "done");
  EXPECT_FALSE(fs::exists(job_folder(job) / "printer.goo")) << "it is made again from the plan where it is wanted";
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 2, messages against the protocol: 0"));
}

TEST_F(WholePrinters, WaitForAnApprovalAndObeyPauseResumeAndCancel) {
  start_printer("1");
  write_whole_list();
  start_sites({"--start", "on-approval", "--web", "127.0.0.1:0"});
  const std::string job = submit_for("toy", "4");
  await_state(job, "awaiting-approval");
  EXPECT_EQ(journal_of(job), "");
  ASSERT_EQ(at_fab({"approve", job, "--who", "ana"}).code, 0);
  ASSERT_TRUE(await([&] { return prints_layers(job); })) << says();
  EXPECT_EQ(state_of("saturn"), "printing");
  const auto port = static_cast<std::uint16_t>(std::stoi(text_of(folder() / "fab" / "web-port")));
  const std::string answer = http_ask(port, "GET", "/v1/machines", "", "");
  const Json now = Json::parse(answer.substr(answer.find("\r\n\r\n")))["machines"][0]["now"];
  EXPECT_THAT(now["phase"].get<std::string>(), testing::AnyOf("exposing", "lifting", "lowering")) << now;
  EXPECT_TRUE(now["z_mm"].is_null()) << "the printer does not say";
  ASSERT_EQ(at_fab({"pause", job, "--who", "ana"}).code, 0);
  ASSERT_TRUE(await([&] { return state_of("saturn") == "paused"; })) << says();
  await_state(job, "paused");
  ASSERT_EQ(at_fab({"resume", job, "--who", "ana"}).code, 0);
  await_state(job, "printing");
  const Outcome cancelled = at_fab({"cancel", job, "--who", "eve"});
  ASSERT_EQ(cancelled.code, 0) << cancelled.errors << says();
  await_state(job, "cancelled");
  const Json record = record_of(job);
  EXPECT_EQ(record["end"], "stopped");
  EXPECT_EQ(record["orders"].size(), 4U) << record;
  EXPECT_EQ(state_of("saturn"), "occupied");
  expect_once();
}

TEST_F(WholePrinters, GoOnWhileTheFabIsKilledAndAreNeverStartedTwice) {
  start_printer("0.2");
  write_whole_list();
  start_sites({"--platform", "automatic"});
  const char* asked = std::getenv("TELEFAB_WHOLE_KILLS");
  const int kills = asked ? std::atoi(asked) : 6;
  std::mt19937 random{7};
  int killed = 0, prints = 0;
  std::map<std::string, int> behind;  // the last line of the printer's journal when it was killed
  while (killed < kills) {
    const std::string job = submit_for("toy", "2");
    ++prints;
    std::set<std::string> seen;
    const auto until = std::chrono::steady_clock::now() + 120s;
    while (job_state(job) != "done" && std::chrono::steady_clock::now() < until) {
      ASSERT_NE(job_state(job), "failed") << says();
      if (job_state(job) == "paused") look_and_resume(job);
      if (killed >= kills) {
        std::this_thread::sleep_for(50ms);
        continue;
      }
      // The first print is killed behind each line, as soon as that is there; the others at any time.
      bool is_due = prints > 1;
      if (is_due) std::this_thread::sleep_for(std::chrono::milliseconds{random() % 1500});
      for (const std::string step : {"planned", "uploaded", "starting", "started"})
        if (prints == 1 && has_step(job, step) && seen.insert(step).second) is_due = true;
      if (!is_due) continue;
      kill_fab();
      ++killed;
      ++behind[last_step(job)];
      start_fab(with_list({"--platform", "automatic"}));
    }
    ASSERT_EQ(job_state(job), "done") << says();
    EXPECT_EQ(record_of(job)["end"], "done");
  }
  std::string where;
  for (const auto& [step, count] : behind) where += fmt::format(" {} {}", step.empty() ? "nothing" : step, count);
  std::cout << fmt::format("  {} kills in {} prints; behind{}\n", killed, prints, where);
  EXPECT_EQ(starts_at_end(), prints);
}

TEST_F(WholePrinters, WhoseJournalIsDamagedStartNothingUntilSomebodyHasLooked) {
  start_printer("0.5");
  write_whole_list();
  start_sites();
  const std::string job = submit_for("toy", "2");
  ASSERT_TRUE(await([&] { return has_step(job, "started"); })) << says();
  kill_fab();
  const fs::path path = job_folder(job) / "printer.journal";
  std::string journal = text_of(path);
  journal[journal.size() / 2] ^= 1;
  std::ofstream{path} << journal;
  start_fab(with_list());
  await_state(job, "paused");
  EXPECT_THAT(message_of(job), HasSubstr("treat-as-started"));
  look_and_resume(job);
  await_state(job, "done");
  EXPECT_TRUE(fs::exists(job_folder(job) / "printer.journal.damaged-1"));
  EXPECT_THAT(record_of(job)["journal_gaps"][0].get<std::string>(), HasSubstr("set aside by ana"));
  expect_once();
}

TEST_F(WholePrinters, ThatWereNotInTheListForAWhileAreWatchedAgainAndObey) {
  start_printer("0.8");
  write_whole_list();
  start_sites();
  const std::string job = submit_for("toy", "4");
  ASSERT_TRUE(await([&] { return has_step(job, "started"); })) << says();
  kill_fab();
  write_list({"own"});
  start_fab(with_list());
  await_state(job, "paused");
  EXPECT_THAT(message_of(job), HasSubstr("saturn"));
  kill_fab();
  write_whole_list();
  start_fab(with_list());
  expect_stopped_by_cancel(job);
}

TEST_F(WholePrinters, ThatAreSwitchedOffAreWaitedForAndDisturbNobody) {
  start_printer();
  write_whole_list({"own"});
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 0"));
  start_sites();
  ASSERT_TRUE(await([&] { return state_of("saturn") == "offline"; })) << says();
  const std::string for_it = submit_for("saturn", "1"), other = submit_for("own", "2");
  await_state(other, "done");
  ASSERT_TRUE(await([&] { return message_of(for_it).find("waits for saturn, which is offline") != std::string::npos; }))
      << says();
  EXPECT_EQ(state_of("own"), "idle");
  start_printer();
  await_state(for_it, "done");
  expect_once();
}

TEST_F(WholePrinters, OutOfReachAreSaidToBeAndTheirPrintIsWatchedAgain) {
  const std::string job = print_begun("0.3");
  printer_->send_signal(SIGSTOP);
  ASSERT_TRUE(await([&] { return state_of("saturn") == "offline"; })) << says();
  EXPECT_EQ(job_state(job), "printing") << "it goes on there, as far as anybody knows";
  printer_->send_signal(SIGCONT);
  await_state(job, "done");
  expect_once();
}

TEST_F(WholePrinters, StopAtACancelThoughTheirMachineHasAnotherResinByNow) {
  const std::string job = print_begun("3");
  kill_fab();
  write_whole_list({}, "resin = \"generic-blue\"\n");
  start_fab(with_list());
  expect_stopped_by_cancel(job);
}

TEST_F(WholePrinters, StopAtACancelThoughTheirProfileWasEditedMeanwhile) {
  const std::string job = print_begun("3");
  kill_fab();
  write_profile("5.0");  // each layer needs more light: the file would be another one
  start_fab(with_list());
  expect_stopped_by_cancel(job);
}

TEST_F(WholePrinters, AreWatchedToTheirEndThoughWhatTheirJobChoseIsNotThereAnyMore) {
  const fs::path chosen = folder() / "prints" / "mine.toml";
  fs::create_directories(chosen.parent_path());
  std::ofstream{chosen} << "name = \"mine\"\n[motion]\nlift_mm = 3.0\n";
  const std::string job = print_begun("0.5", {"--print", "mine"});
  kill_fab();
  fs::remove(chosen);
  start_fab(with_list());
  await_state(job, "printing");
  await_state(job, "done");
  EXPECT_EQ(record_of(job)["end"], "done");
  EXPECT_EQ(state_of("saturn"), "occupied");
  expect_once();
}

TEST_F(WholePrinters, OfAProfileThatIsNotThereAnyMoreHoldAJobThatWasNotBegun) {
  const fs::path chosen = folder() / "prints" / "mine.toml";
  fs::create_directories(chosen.parent_path());
  const std::string text = "name = \"mine\"\n[motion]\nlift_mm = 3.0\n";
  std::ofstream{chosen} << text;
  start_printer();
  write_whole_list();
  start_sites({"--start", "on-approval"});
  const std::string job = submit_for("toy", "1", {"--print", "mine"});
  await_state(job, "awaiting-approval");
  kill_fab();
  fs::remove(chosen);
  start_fab(with_list({"--start", "on-approval"}));
  (void)at_fab({"approve", job});
  ASSERT_TRUE(await([&] { return message_of(job).find("mine") != std::string::npos; })) << says();
  EXPECT_NE(job_state(job), "failed");
  kill_fab();
  std::ofstream{chosen} << text;
  start_fab(with_list({"--start", "on-approval"}));
  if (job_state(job) == "paused") (void)at_fab({"resume", job});
  if (job_state(job) == "awaiting-approval") (void)at_fab({"approve", job});
  await_state(job, "done");
  expect_once();
}

TEST_F(WholePrinters, LeaveAPrintToTheLightThatBeganIt) {
  write_profile("4.0", 50);  // slow enough to be killed amid the print
  write_list({"saturn"});    // light of the fab's own
  start_fab(with_list({"--start", "on-approval"}));
  start_scan();
  ASSERT_TRUE(await([&] { return telefab({"machines"}).output.find("any of") != std::string::npos; })) << says();
  const std::string begun = submit_for("toy", "4"), waits = submit_for("toy", "2");
  await_state(waits, "awaiting-approval");
  await_state(begun, "awaiting-approval");
  ASSERT_EQ(at_fab({"approve", begun}).code, 0);
  ASSERT_TRUE(await([&] { return lights(begun) > 2; })) << says();
  kill_fab();
  start_printer();
  write_whole_list();
  start_fab(with_list({"--start", "on-approval"}));
  await_state(begun, "paused");
  const auto resume_looked_at = [&] {
    std::vector<std::string> words{"resume", begun};
    if (message_of(begun).find("treat-as-exposed") != std::string::npos)
      words.insert(words.end(), {"--as", "treat-as-exposed"});
    ASSERT_EQ(at_fab(words).code, 0) << says();
  };
  if (message_of(begun).find("began by light of this fab") == std::string::npos) resume_looked_at();
  ASSERT_TRUE(await([&] { return message_of(begun).find("began by light of this fab") != std::string::npos; }))
      << says();
  const Outcome asked = at_fab({"resume", begun, "--as", "start-again"});
  EXPECT_EQ(asked.code, 2) << "no start of it is in question: " << asked.output;
  EXPECT_EQ(journal_of(begun), "");
  kill_fab();
  write_profile("4.0");
  write_list({"saturn"});
  start_fab(with_list({"--start", "on-approval"}));
  if (job_state(begun) == "paused") resume_looked_at();
  await_state(begun, "done");
  ASSERT_EQ(at_fab({"approve", waits}).code, 0) << "it goes by whichever light stands there now";
  await_state(waits, "done");
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 0"));
}

TEST_F(WholePrinters, OfAnotherModelAreRefusedByName) {
  start_printer("0.1", "ELEGOO Other");
  write_whole_list();
  start_sites();
  const std::string job = submit_for("toy", "1");
  await_state(job, "paused");
  EXPECT_THAT(message_of(job), HasSubstr("file.model"));
  EXPECT_EQ(state_of("saturn"), "fault");
  EXPECT_EQ(at_fab({"resume", job, "--as", "start-again"}).code, 2) << "no start of it is in question";
  ASSERT_EQ(at_fab({"cancel", job}).code, 0);
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 0"));
}

}  // namespace
}  // namespace telefab::test
