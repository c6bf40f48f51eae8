// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <iostream>

#include "whole_printers.hpp"

// What goes wrong at a whole printer, and what the fab makes of it. TELEFAB_WHOLE_FAULTS=all tries every fault at every
// moment (some minutes); else one each of what differs.

namespace telefab::test {
namespace {

using testing::HasSubstr;

struct Trial {
  std::string fault, moment;
};

class WholePrinterFaults : public WholePrinters {
 protected:
  static std::vector<Trial> trials() {
    if (std::getenv("TELEFAB_WHOLE_FAULTS") == nullptr)
      return {{"full-storage", "upload"}, {"cut-upload", "upload"}, {"lost-answer", "start"}, {"busy", "start"},
              {"wrong-model", "start"},   {"reboots", "watch"},     {"other-task", "watch"}};
    std::vector<Trial> all;
    for (const std::string fault : {"wrong-model", "wrong-resolution", "wrong-format", "full-storage", "cut-upload",
                                    "lost-offset", "bad-checksum", "lost-socket", "lost-answer", "no-answer", "busy",
                                    "silent", "other-task", "too-many-clients", "reboots"})
      for (const std::string moment : {"upload", "start", "watch"}) all.push_back({fault, moment});
    return all;
  }
  [[nodiscard]] bool is_over(const std::string& job) const {
    const std::string state = job_state(job);
    return state == "done" || state == "failed" || state == "cancelled";
  }
  void await_idle() const {
    ASSERT_TRUE(await([&] {
      const std::string state = state_of("saturn");
      if (state == "offline") (void)at_fab({"cleared", "saturn"});  // it is looked for now
      return state == "idle";
    })) << says();
  }
  /// It goes on, or the fab says why it does not. A printer is out of reach where it does not answer.
  [[nodiscard]] bool is_settled(const std::string& job, bool may_be_lost) const {
    if (is_over(job) || job_state(job) == "paused") return true;
    return may_be_lost &&
           (state_of("saturn") == "offline" || message_of(job).find("waits for saturn") != std::string::npos);
  }
};

TEST_F(WholePrinterFaults, AreNamedAndNoPrintIsStartedTwiceAndEachComesToAnEnd) {
  start_printer();
  write_whole_list();
  (void)end_of_printer();
  start_sites();
  std::map<std::string, int> ends;
  for (const Trial& trial : trials()) {
    SCOPED_TRACE(trial.fault + " at " + trial.moment);
    start_printer(trial.moment == "watch" ? "0.3" : "0.05", "ELEGOO Toy",
                  {"--fault", trial.fault, "--fault-at", trial.moment});
    await_idle();
    const std::string job = submit_for("toy", "1");
    const bool may_be_lost = trial.moment != "upload" || trial.fault == "silent" || trial.fault == "too-many-clients" ||
                             trial.fault == "reboots";
    ASSERT_TRUE(await([&] { return is_settled(job, may_be_lost); }, 120)) << says();
    std::this_thread::sleep_for(std::chrono::seconds{3});  // one that comes back by itself does so
    ASSERT_TRUE(await([&] { return is_settled(job, may_be_lost); }, 120)) << says();
    const std::string first = message_of(job);
    int starts = starts_at_end();
    if (!is_over(job)) {
      EXPECT_NE(first, "");
      start_printer("0.05");
      ASSERT_TRUE(await(
          [&] {
            // What was begun at the panel is taken off by whoever looks.
            if (message_of(job).find("telefab cleared saturn") != std::string::npos)
              (void)at_fab({"cleared", "saturn"});
            if (job_state(job) != "paused") return is_over(job);
            // Whoever decides knows what the printer did before it was switched off and on.
            std::vector<std::string> words{"resume", job, "--who", "ana"};
            if (message_of(job).find("treat-as-started") != std::string::npos)
              words.insert(words.end(), {"--as", starts > 0 ? "treat-as-started" : "start-again"});
            (void)at_fab(words);  // its message says what it needs, and the next look sees what came of it
            return is_over(job);
          },
          120))
          << says();
      starts += starts_at_end();
    }
    const std::string end = job_state(job);
    std::cout << fmt::format("  {} at {}: {} ({}), {} start(s)\n", trial.fault, trial.moment, end, first.substr(0, 70),
                             starts);
    ++ends[end];
    EXPECT_LE(starts, 1);
    if (end == "done") {
      EXPECT_EQ(starts, 1);
    }
    EXPECT_NE(end, "cancelled") << "nobody asked for it";
    // Another print may be on the platform, by the panel.
    if (await([&] { return state_of("saturn") == "occupied" || state_of("saturn") == "offline"; }, 15))
      (void)at_fab({"cleared", "saturn"});
  }
  EXPECT_GT(ends["done"], 0);
}

TEST_F(WholePrinterFaults, LeaveAStartThatNobodyKnowsOfToAnOperatorEvenOverARestart) {
  // It hangs up at the question, and as a new printer it has no task whose name would prove that nothing came of it.
  start_printer("0.2", "ELEGOO Toy", {"--fault", "lost-socket", "--fault-at", "start"});
  write_whole_list();
  start_sites();
  const std::string job = submit_for("toy", "1");
  await_state(job, "paused", 90);
  EXPECT_THAT(message_of(job), HasSubstr("--as treat-as-started"));
  EXPECT_EQ(state_of("saturn"), "paused");
  const Outcome plain = at_fab({"resume", job, "--who", "ana"});
  EXPECT_EQ(plain.code, 2) << plain.output;
  EXPECT_THAT(plain.errors, HasSubstr("start-again"));
  EXPECT_EQ(at_fab({"resume", job, "--as", "expose-again", "--who", "ana"}).code, 2) << "no layer is in question";
  kill_fab();
  start_fab(with_list());
  // It looks for itself first, and refuses the word as long as it does.
  ASSERT_TRUE(await(
      [&] {
        return at_fab({"resume", job, "--as", "start-again", "--who", "ana"}).code == 0;
      },
      90))
      << says();
  await_state(job, "done");
  const Json record = record_of(job);
  EXPECT_EQ(record["orders"][1]["what"], "resumed") << record;
  EXPECT_EQ(record["orders"][2]["what"], "decided-start-again") << record;
  EXPECT_EQ(record["orders"][2]["by"], "ana");
  expect_once();
}

}  // namespace
}  // namespace telefab::test
