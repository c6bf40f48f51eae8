// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "whole_print_bench.hpp"

namespace telefab::fab {
namespace {

using test::WholePrintBench;

TEST(WholePrint, IsSentInPartsStartedOnceAndWatchedToItsEnd) {
  for (const bool has_printed_before : {false, true}) {
    WholePrintBench bench{has_printed_before};
    std::vector<WholePrintPhase> phases;
    double most_sent = 0;
    std::uint32_t most_layer = 0;
    const auto report = bench.run([&](const WholePrintEvent& event) {
      if (phases.empty() || phases.back() != event.phase) phases.push_back(event.phase);
      most_sent = std::max(most_sent, event.share);
      most_layer = std::max(most_layer, event.task.layer);
    });
    ASSERT_TRUE(report) << report.error().what;
    EXPECT_EQ(report->outcome, WholePrintOutcome::Done) << report->message;
    EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
    EXPECT_EQ(bench.model.layers_of("part.goo"), WholePrintBench::kLayers);
    EXPECT_EQ(bench.model.stored("part.goo"), bench.bytes);
    EXPECT_THAT(bench.model.violations(), testing::IsEmpty());
    using enum WholePrintPhase;
    EXPECT_THAT(phases, testing::ElementsAre(Checking, Uploading, Checking, Starting, Printing));
    EXPECT_EQ(most_sent, 1);
    EXPECT_EQ(most_layer, WholePrintBench::kLayers);
    // Again: the end is known, and nothing is sent or started.
    const std::size_t interactions = bench.model.interactions();
    const auto again = bench.run();
    ASSERT_TRUE(again);
    EXPECT_EQ(again->outcome, WholePrintOutcome::Done);
    EXPECT_EQ(bench.model.interactions(), interactions);
  }
}

/// What a refusal must name, where the fault is one that the printer can be asked about.
PrinterProblem problem_of(SdcpFault fault) {
  switch (fault) {
    case SdcpFault::WrongModel:
      return PrinterProblem::WrongModel;
    case SdcpFault::WrongResolution:
      return PrinterProblem::WrongResolution;
    case SdcpFault::WrongFormat:
      return PrinterProblem::WrongFormat;
    case SdcpFault::FullStorage:
      return PrinterProblem::StorageFull;
    case SdcpFault::Busy:
      return PrinterProblem::Busy;
    default:
      return PrinterProblem::None;
  }
}

class WholePrintFaults : public testing::TestWithParam<std::size_t> {};

TEST_P(WholePrintFaults, AtEveryStepAreNamedAndNothingIsStartedTwice) {
  const auto fault = static_cast<SdcpFault>(GetParam());
  std::size_t steps = 0;
  {
    WholePrintBench bench;
    const std::size_t before = bench.model.interactions();
    ASSERT_TRUE(bench.run());
    steps = bench.model.interactions() - before;
  }
  ASSERT_GT(steps, 10U);
  std::map<std::string, int> outcomes;
  std::size_t refusals = 0, decisions = 0, failures = 0;
  for (const bool has_printed_before : {true, false})
    for (std::size_t step = 0; step < steps; ++step) {
      WholePrintBench bench{has_printed_before};
      bench.model.inject(fault, bench.model.interactions() + step);
      std::optional<WholePrintReport> last;
      int runs = 0;
      for (; runs < 8; ++runs) {
        const auto report = bench.run();
        ASSERT_LE(bench.model.starts_of("part.goo"), 1U) << "step " << step;
        if (!report) {
          EXPECT_FALSE(report.error().what.empty());
          EXPECT_NE(report.error().code, ErrorCode::Internal);
          ++failures;
          bench.model.repair();
          continue;
        }
        last = *report;
        if (report->outcome == WholePrintOutcome::Refused) {
          ++refusals;
          EXPECT_FALSE(report->message.empty());
          if (problem_of(fault) != PrinterProblem::None) {
            EXPECT_EQ(report->problem, problem_of(fault)) << report->message;
          }
          EXPECT_EQ(bench.model.starts_of("part.goo"), 0U);
          bench.model.repair();
          continue;
        }
        if (report->outcome != WholePrintOutcome::AwaitingDecision) break;
        ++decisions;
        bench.model.repair();
        bench.decide();
      }
      ASSERT_TRUE(last) << "step " << step;
      ++outcomes[std::string{name_of(last->outcome)}];
      EXPECT_THAT(bench.model.violations(), testing::IsEmpty()) << "step " << step;
      const bool ends_early = fault == SdcpFault::Reboots || fault == SdcpFault::OtherTask;
      if (last->outcome == WholePrintOutcome::Done) {
        EXPECT_EQ(bench.model.starts_of("part.goo"), 1U) << "step " << step;
        EXPECT_EQ(bench.model.layers_of("part.goo"), WholePrintBench::kLayers) << "step " << step;
      } else {
        EXPECT_TRUE(ends_early) << "step " << step << ": " << name_of(last->outcome) << ", " << last->message;
        EXPECT_TRUE(last->outcome == WholePrintOutcome::Stopped || last->outcome == WholePrintOutcome::Unknown);
        EXPECT_LT(bench.model.layers_of("part.goo"), WholePrintBench::kLayers);
      }
    }
  std::string text;
  for (const auto& [name, count] : outcomes) text += name + " " + std::to_string(count) + ", ";
  testing::Test::RecordProperty("outcomes", text);
  std::printf("  %zu steps x 2: %s%zu refusals, %zu runs failed, %zu decisions\n", steps, text.c_str(), refusals,
              failures, decisions);
  EXPECT_GT(outcomes["done"], 0);
  if (problem_of(fault) != PrinterProblem::None) {
    EXPECT_GT(refusals, 0U);
  }
}
INSTANTIATE_TEST_SUITE_P(All, WholePrintFaults, testing::Range<std::size_t>(0, kSdcpFaults));

TEST(WholePrint, IsNotSentForEverToAPrinterThatAnswersAndBreaksEveryUploadOff) {
  WholePrintBench bench;
  bench.model.inject_when(SdcpFault::CutUpload, SdcpMoment::Upload);
  const auto report = bench.run();
  ASSERT_TRUE(report) << "as if it had been switched off: " << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Refused);
  EXPECT_THAT(report->message, testing::HasSubstr("could not be sent in 3 tries"));
  EXPECT_EQ(bench.model.starts_of("part.goo"), 0U);
  bench.model.repair();
  EXPECT_EQ(bench.run()->outcome, WholePrintOutcome::Done);
}

TEST(WholePrint, RefusesAPrinterThatIsNotTheOneOfItsProfile) {
  WholePrintBench bench;
  SdcpOptions options;
  options.address.host = "127.0.0.1";
  options.id = "ffffffffffffffff";
  const auto driver = make_sdcp_printer(*bench.network, bench.clock, options);
  const auto facts = driver->facts();
  ASSERT_FALSE(facts);
  EXPECT_EQ(facts.error().code, ErrorCode::NotTrusted);
  EXPECT_THAT(facts.error().what, testing::HasSubstr(bench.printer.id));
}

TEST(WholePrint, SendsADamagedFileAgain) {
  WholePrintBench bench;
  bench.model.inject(SdcpFault::BadChecksum, bench.model.interactions());
  int uploads = 0;
  double last = 1;
  const auto report = bench.run([&](const WholePrintEvent& event) {
    if (event.phase != WholePrintPhase::Uploading) return;
    if (event.share < last) ++uploads;
    last = event.share;
  });
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done);
  EXPECT_EQ(uploads, 2);
  EXPECT_EQ(bench.model.stored("part.goo"), bench.bytes);
}

}  // namespace
}  // namespace telefab::fab
