// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "whole_print_bench.hpp"

namespace telefab::fab {
namespace {

using test::WholePrintBench;
using testing::HasSubstr;

TEST(WholePrintWords, OfPauseAndResumeAreFollowedByThePrinter) {
  WholePrintBench bench;
  PrintControl control;
  bool was_paused = false;
  int kept = 0;
  const auto on_kept = [&](const auto& outcome) { kept += outcome && *outcome ? 1 : 0; };
  const auto report = bench.run(
      [&](const WholePrintEvent& event) {
        if (event.task.state == TaskState::Exposing && !was_paused && event.task.layer == 2)
          control.pause("ada", on_kept), was_paused = true;
        if (event.task.state == TaskState::Paused) control.resume("ada", on_kept);
      },
      &control);
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done);
  EXPECT_TRUE(was_paused);
  EXPECT_EQ(kept, 2);
  EXPECT_EQ(bench.model.layers_of("part.goo"), WholePrintBench::kLayers);
  EXPECT_THAT(bench.journal, testing::AllOf(HasSubstr("pause-asked"), HasSubstr("resumed"), HasSubstr("ada")));
}

TEST(WholePrintWords, OfCancelStopThePrinterAlsoWhereTheLineBreaksJustThen) {
  for (const SdcpFault fault : {SdcpFault::None, SdcpFault::LostSocket, SdcpFault::LostAnswer, SdcpFault::NoAnswer}) {
    WholePrintBench bench;
    PrintControl control;
    bool is_asked = false;
    const auto report = bench.run(
        [&](const WholePrintEvent& event) {
          if (event.task.layer != 1 || std::exchange(is_asked, true)) return;
          bench.model.inject(fault, bench.model.interactions());
          control.cancel("ada");
        },
        &control);
    ASSERT_TRUE(report) << report.error().what;
    EXPECT_EQ(report->outcome, WholePrintOutcome::Stopped);
    EXPECT_LT(bench.model.layers_of("part.goo"), WholePrintBench::kLayers);
  }
}

TEST(WholePrintWords, OfACancelThatWasKeptBeforeACrashStopThePrintAfterIt) {
  WholePrintBench bench;
  bool is_first = true;
  PrintControl control;
  std::stop_source stop;
  auto opened = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  SdcpOptions options;
  options.address.host = "127.0.0.1";
  {
    const auto driver = make_sdcp_printer(*bench.network, bench.clock, options);
    const auto report = WholePrintRunner{*driver, opened, bench.clock}.run(
        bench.job, {}, control,
        [&](const WholePrintEvent& event) {
          if (event.task.layer == 1 && std::exchange(is_first, false)) stop.request_stop();
        },
        stop.get_token());
    ASSERT_TRUE(report);
    ASSERT_EQ(report->outcome, WholePrintOutcome::Interrupted);
  }
  PrinterJournalEntry word;
  word.step = PrinterStep::CancelAsked;
  word.by = "ada";
  ASSERT_TRUE(opened.write(word));
  const auto report = bench.run();
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Stopped);
  EXPECT_LT(bench.model.layers_of("part.goo"), WholePrintBench::kLayers);
}

TEST(WholePrintWords, BeforeTheStartHoldThePrintUntilItIsResumed) {
  WholePrintBench bench;
  PrintControl control;
  const auto held = bench.run(
      [&](const WholePrintEvent& event) {
        if (event.phase == WholePrintPhase::Uploading) control.pause("ada");
      },
      &control);
  ASSERT_TRUE(held);
  EXPECT_EQ(held->outcome, WholePrintOutcome::Held);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 0U);
  EXPECT_EQ(bench.run()->outcome, WholePrintOutcome::Held);
  PrintControl again;
  again.resume("ada");
  const auto done = bench.run({}, &again);
  ASSERT_TRUE(done) << done.error().what;
  EXPECT_EQ(done->outcome, WholePrintOutcome::Done);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
}

TEST(WholePrintWords, ThatThePrinterDoesNotFollowAreRefusedByName) {
  WholePrintBench bench;
  PrintControl control;
  std::optional<Error> refused;
  bool is_first = true;
  const auto report = bench.run(
      [&](const WholePrintEvent& event) {
        if (event.phase == WholePrintPhase::Printing && std::exchange(is_first, false))
          control.resume("ada", [&](const auto& outcome) {
            if (outcome && !*outcome) refused = outcome->error();
          });
      },
      &control);
  ASSERT_TRUE(report);
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done);
  ASSERT_TRUE(refused) << "a print that is not paused cannot be resumed";
  EXPECT_EQ(refused->code, ErrorCode::DeviceRefused);
}

TEST(WholePrint, ThatIsOnlySentStartsNothingUntilItIsAskedTo) {
  WholePrintBench bench;
  auto opened = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  SdcpOptions options;
  options.address.host = "127.0.0.1";
  const auto driver = make_sdcp_printer(*bench.network, bench.clock, options);
  PrintControl control;
  WholePrintPolicy policy;
  policy.starts = false;
  for (int i = 0; i < 2; ++i) {
    const auto sent = WholePrintRunner{*driver, opened, bench.clock}.run(bench.job, policy, control, {}, {});
    ASSERT_TRUE(sent) << sent.error().what;
    EXPECT_EQ(sent->outcome, WholePrintOutcome::Sent);
    EXPECT_EQ(bench.model.stored("part.goo"), bench.bytes);
    EXPECT_EQ(bench.model.starts_of("part.goo"), 0U);
  }
  EXPECT_EQ(bench.run()->outcome, WholePrintOutcome::Done);
}

TEST(WholePrintWords, AboutAStartAreTakenOnlyWhereOneIsInQuestion) {
  WholePrintBench bench;
  ASSERT_TRUE(bench.run());
  auto opened = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  EXPECT_EQ(decide_start(opened, StartDecision::StartAgain, "ada", {}).error().code, ErrorCode::Conflict);
}

}  // namespace
}  // namespace telefab::fab
