// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <telefab/fab/drivers/choose_printer.hpp>

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

TEST(WholePrintWords, AreKeptWhileAPrinterThatIsKnownByItsNameAloneIsOutOfReach) {
  WholePrintBench bench;
  const auto sought = sought_printer(*bench.network, bench.clock, {"", bench.printer.id});
  auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  PrintControl control;
  int kept = 0, lost = 0, kept_while_lost = 0;
  const auto report = WholePrintRunner{*sought, journal, bench.clock}.run(
      bench.job, {}, control,
      [&](const WholePrintEvent& event) {
        if (event.phase == WholePrintPhase::Printing && event.task.layer == 1 && lost == 0)
          bench.model.inject(SdcpFault::Silent, bench.model.interactions());
        if (event.phase != WholePrintPhase::Lost) return;
        if (++lost == 2) control.pause("ada", [&](const auto& outcome) { kept += outcome && *outcome ? 1 : 0; });
        if (lost == 4) kept_while_lost = kept, bench.model.repair();
      },
      {});
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(kept_while_lost, 1);
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done) << "it went on by itself";
  EXPECT_THAT(bench.journal, HasSubstr("pause-asked"));
}

/// A network in which the address of a printer goes to another one.
class MovedNetwork final : public PrinterNetwork {
 public:
  MovedNetwork(PrinterNetwork& first, PrinterNetwork& second) : at_{&first}, second_{second} {}
  /// Connections to the first break.
  void move() { at_ = &second_; }

  Result<std::vector<Datagram>> ask(std::string_view host, std::uint16_t port, std::string_view text,
                                    Nanoseconds wait) override {
    return at_->ask(host, port, text, wait);
  }
  Result<std::unique_ptr<MessageSocket>> connect(const PrinterAddress& where, std::string_view path,
                                                 Nanoseconds timeout) override {
    auto socket = at_->connect(where, path, timeout);
    if (!socket) return socket;
    return std::make_unique<Socket>(*this, *at_, std::move(*socket));
  }
  Result<HttpReply> post(const PrinterAddress& where, std::string_view path, std::string_view type, std::string body,
                         Nanoseconds timeout) override {
    return at_->post(where, path, type, std::move(body), timeout);
  }

 private:
  class Socket final : public MessageSocket {
   public:
    Socket(MovedNetwork& owner, PrinterNetwork& to, std::unique_ptr<MessageSocket> inner)
        : owner_{owner}, to_{to}, inner_{std::move(inner)} {}
    Result<void> send(std::string_view text, Nanoseconds timeout) override {
      if (owner_.at_ != &to_) return fail(ErrorCode::DeviceLost, "the connection broke");
      return inner_->send(text, timeout);
    }
    Result<std::optional<std::string>> receive(Nanoseconds timeout) override {
      if (owner_.at_ != &to_) return fail(ErrorCode::DeviceLost, "the connection broke");
      return inner_->receive(timeout);
    }

   private:
    MovedNetwork& owner_;
    PrinterNetwork& to_;
    std::unique_ptr<MessageSocket> inner_;
  };
  PrinterNetwork* at_;
  PrinterNetwork& second_;
};

TEST(WholePrintWords, NeverReachAnotherPrinterThatGotTheAddressWhileTheirPrintWasWatched) {
  WholePrintBench bench;
  SdcpModelOptions second = bench.printer;
  second.id = "00000000000000ff";
  SdcpModel another{second, bench.clock};
  const auto its_network = model_network(another, bench.clock);
  SdcpOptions there;
  there.address.host = "127.0.0.1";
  const auto its_driver = make_sdcp_printer(*its_network, bench.clock, there);
  std::string its_journal;
  auto theirs = PrinterJournal::open(memory_journal_file(its_journal)).value();
  const std::string long_print = test::goo_bytes(second, 5000);
  std::stop_source has_begun;
  PrintControl nobody;
  const auto left = WholePrintRunner{*its_driver, theirs, bench.clock}.run(
      test::job_of("theirs.goo", long_print, second, 5000), {}, nobody,
      [&](const WholePrintEvent& event) {
        if (event.phase == WholePrintPhase::Printing) has_begun.request_stop();
      },
      has_begun.get_token());
  ASSERT_TRUE(left && left->outcome == WholePrintOutcome::Interrupted);

  MovedNetwork network{*bench.network, *its_network};
  PrintControl control;
  bool has_moved = false;
  const auto report = bench.run_of(
      bench.job, bench.journal, network,
      [&](const WholePrintEvent& event) {
        if (event.task.layer != 1 || std::exchange(has_moved, true)) return;
        network.move();
        control.cancel("ada");
      },
      &control);
  ASSERT_TRUE(has_moved);
  ASSERT_FALSE(report) << "what another printer says is nothing about this print";
  EXPECT_EQ(report.error().code, ErrorCode::NotTrusted);
  EXPECT_THAT(report.error().what, testing::AllOf(HasSubstr(second.id), HasSubstr(bench.printer.id)));
  EXPECT_TRUE(its_driver->status()->activity.prints) << "the word was not for it";
  EXPECT_THAT(bench.journal, testing::AllOf(HasSubstr("cancel-asked"), testing::Not(HasSubstr("finished"))));
  EXPECT_EQ(bench.run()->outcome, WholePrintOutcome::Stopped) << "it is passed on where its print is";
}

TEST(WholePrintWords, OfASecondCancelGiveUpAPrinterThatIsKnownByItsNameAloneAndNotFound) {
  WholePrintBench bench;
  auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  PrintControl control;
  std::stop_source stop;
  const auto life = [&](const WholePrintSink& sink, const std::stop_token& until) {
    const auto sought = sought_printer(*bench.network, bench.clock, {"", bench.printer.id});
    return WholePrintRunner{*sought, journal, bench.clock}.run(bench.job, {}, control, sink, until);
  };
  const auto first = life(
      [&](const WholePrintEvent& event) {
        if (event.task.layer == 1) stop.request_stop();
      },
      stop.get_token());
  ASSERT_TRUE(first) << first.error().what;
  ASSERT_EQ(first->outcome, WholePrintOutcome::Interrupted);
  bench.model.inject(SdcpFault::Silent, bench.model.interactions());
  int lost = 0;
  const auto given_up = life(
      [&](const WholePrintEvent& event) {
        if (event.phase == WholePrintPhase::Lost && ++lost <= 2) control.cancel("ada");
      },
      {});
  ASSERT_TRUE(given_up) << given_up.error().what;
  EXPECT_EQ(given_up->outcome, WholePrintOutcome::Unknown);
  EXPECT_LT(lost, 10) << "in time";
}

TEST(WholePrintWords, BeforeAnythingWasAskedAreKeptAndNothingMore) {
  std::string bytes;
  PrintControl control;
  int kept = 0, refused = 0;
  const auto on_kept = [&](const auto& outcome) { (outcome && *outcome ? kept : refused) += 1; };
  auto orders = PrintJournal::open(memory_journal_file(bytes)).value();
  control.pause("ada", on_kept);
  control.decide(Decision::ExposeAgain, "ada", on_kept);
  control.cancel("eve", on_kept);
  ASSERT_TRUE(keep_words(control, orders, {}));
  EXPECT_EQ(kept, 2);
  EXPECT_EQ(refused, 1) << "no layer is in question";
  EXPECT_EQ(PrintJournal::open(memory_journal_file(bytes))->order().by, "eve");
  EXPECT_FALSE(control.take());
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

/// A printer that remembers the numbers of what it was asked.
class RecordingPeer final : public PrinterPeer {
 public:
  explicit RecordingPeer(SdcpModel& inner) : inner_{inner} {}
  std::optional<std::string> on_datagram(std::string_view text) override { return inner_.on_datagram(text); }
  bool lets_in(std::size_t clients) override { return inner_.lets_in(clients); }
  PeerAnswer on_message(std::string_view text) override {
    if (const std::size_t at = text.find("\"RequestID\":\""); at != std::string_view::npos) {
      requests.insert(std::string{text.substr(at + 13, 16)});
      ++count;
    }
    return inner_.on_message(text);
  }
  std::optional<HttpReply> on_post(std::string_view path, std::string_view type, std::string_view body) override {
    return inner_.on_post(path, type, body);
  }
  std::vector<std::string> pushed() override { return inner_.pushed(); }
  std::set<std::string> requests;
  std::size_t count = 0;

 private:
  SdcpModel& inner_;
};

TEST(WholePrint, ThatStartsLateIsWatchedAndNotStartedAgain) {
  WholePrintBench bench;
  // Asked in an earlier life, which took it for not started; the printer began all the same, behind its back.
  const auto network = model_network(bench.model, bench.clock);
  {
    auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
    SdcpOptions options;
    options.address.host = "127.0.0.1";
    const auto driver = make_sdcp_printer(*network, bench.clock, options);
    WholePrintPolicy sent;
    sent.starts = false;
    PrintControl control;
    ASSERT_EQ(WholePrintRunner(*driver, journal, bench.clock).run(bench.job, sent, control, {}, {})->outcome,
              WholePrintOutcome::Sent);
    PrinterJournalEntry asked;
    asked.step = PrinterStep::Starting;
    asked.printer = bench.printer.id;
    asked.task = driver->status()->task.id;
    ASSERT_FALSE(asked.task.empty());
    ASSERT_TRUE(journal.write(asked));
    PrinterJournalEntry refused;
    refused.step = PrinterStep::NotStarted;
    ASSERT_TRUE(journal.write(refused));
    ASSERT_EQ(*driver->start("part.goo"), PrinterProblem::None);
  }
  const auto report = bench.run();
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
}

TEST(WholePrint, NumbersItsRequestsOtherwiseInEveryLife) {
  WholePrintBench bench;
  RecordingPeer peer{bench.model};
  const auto network = model_network(peer, bench.clock);
  for (int life = 0; life < 3; ++life) ASSERT_TRUE(bench.run_of(bench.job, bench.journal, *network));
  SdcpOptions options;
  options.address.host = "127.0.0.1";
  for (int life = 0; life < 3; ++life) ASSERT_TRUE(make_sdcp_printer(*network, bench.clock, options)->status());
  EXPECT_GT(peer.count, 6U);
  EXPECT_EQ(peer.requests.size(), peer.count);
}

TEST(WholePrint, WithOrdersInAJournalOfTheirOwnIsStartedOnlyByALivingOne) {
  const auto line = [](JournalStep step) {
    JournalEntry entry;
    entry.step = step;
    entry.by = "ana";
    return entry;
  };
  const auto outcome_of = [&](WholePrintBench& bench, std::string& orders, std::vector<JournalStep> words) {
    auto kept = PrintJournal::open(memory_journal_file(orders)).value();
    for (const JournalStep word : words) EXPECT_TRUE(kept.write(line(word)));
    auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
    SdcpOptions options;
    options.address.host = "127.0.0.1";
    const auto driver = make_sdcp_printer(*bench.network, bench.clock, options);
    PrintControl control;
    return WholePrintRunner{*driver, journal, bench.clock, &kept}.run(bench.job, {}, control, {}, {}).value().outcome;
  };
  using enum JournalStep;
  WholePrintBench bench;
  std::string orders;
  EXPECT_EQ(outcome_of(bench, orders, {}), WholePrintOutcome::Held) << "nobody's word";
  EXPECT_EQ(outcome_of(bench, orders, {Approved, PauseAsked}), WholePrintOutcome::Held);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 0U);
  EXPECT_EQ(outcome_of(bench, orders, {Resumed}), WholePrintOutcome::Done);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
  WholePrintBench cancelled;
  std::string never;
  EXPECT_EQ(outcome_of(cancelled, never, {Approved, CancelAsked, Approved}), WholePrintOutcome::Held);
  EXPECT_EQ(cancelled.model.starts_of("part.goo"), 0U);
}

TEST(WholePrint, IsGivenUpByASecondCancelWhileItsPrinterDoesNotAnswer) {
  WholePrintBench bench;
  PrintControl control;
  int lost = 0;
  const auto report = bench.run(
      [&](const WholePrintEvent& event) {
        if (event.phase == WholePrintPhase::Printing && event.task.layer == 2)
          bench.model.inject(SdcpFault::Silent, bench.model.interactions());
        if (event.phase == WholePrintPhase::Lost && ++lost <= 2) control.cancel("ana");
      },
      &control);
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Unknown);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
}

TEST(WholePrint, IsNotStartedWithoutTheLeaveOfItsFenceAndNeedsNoneOnceItWasAskedFor) {
  class Gate final : public LightFence {
   public:
    std::uint32_t attempt() const override { return 4; }
    Leave leave(LayerIndex) override { return answer; }
    Leave answer;
  };
  WholePrintBench bench;
  Gate gate;
  const auto run = [&] {
    auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
    SdcpOptions options;
    options.address.host = "127.0.0.1";
    const auto driver = make_sdcp_printer(*bench.network, bench.clock, options);
    PrintControl control;
    const WholePrintSink refuse_once_started = [&](const WholePrintEvent& event) {
      if (event.phase == WholePrintPhase::Printing)
        gate.answer = {LeaveState::Refused, FenceRefusal::Superseded, "attempt 5 is under way"};
    };
    return WholePrintRunner{*driver, journal, bench.clock, nullptr, &gate}
        .run(bench.job, {}, control, refuse_once_started, {})
        .value();
  };
  for (const auto& [state, why] :
       {std::pair{LeaveState::Refused, FenceRefusal::Superseded}, {LeaveState::Awaited, FenceRefusal::Unanswered}}) {
    gate.answer = {state, why, "not now"};
    const auto report = run();
    EXPECT_EQ(report.outcome, WholePrintOutcome::Withheld);
    EXPECT_EQ(report.withheld, why);
  }
  EXPECT_EQ(bench.model.starts_of("part.goo"), 0U);
  EXPECT_EQ(PrinterJournal::open(memory_journal_file(bench.journal)).value().last(PrinterStep::Starting), nullptr);
  gate.answer = {};
  EXPECT_EQ(run().outcome, WholePrintOutcome::Done);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
  const auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  ASSERT_NE(journal.last(PrinterStep::Starting), nullptr);
  EXPECT_EQ(journal.last(PrinterStep::Starting)->attempt, 4U);
}

}  // namespace
}  // namespace telefab::fab
