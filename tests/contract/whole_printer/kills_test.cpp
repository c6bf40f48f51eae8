// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "whole_print_bench.hpp"

namespace telefab::fab {
namespace {

using test::WholePrintBench;

struct Killed {};

/// This side dies before or behind its n-th call of the network.
class KillingNetwork final : public PrinterNetwork {
 public:
  KillingNetwork(PrinterNetwork& inner, std::size_t at, bool behind) : inner_{inner}, at_{at}, behind_{behind} {}

  template <class Call>
  auto guarded(const Call& call) {
    const bool is_it = calls_++ == at_;
    if (is_it && !behind_) throw Killed{};
    auto done = call();
    if (is_it) throw Killed{};
    return done;
  }
  Result<std::vector<Datagram>> ask(std::string_view host, std::uint16_t port, std::string_view text,
                                    Nanoseconds wait) override {
    return guarded([&] { return inner_.ask(host, port, text, wait); });
  }
  Result<std::unique_ptr<MessageSocket>> connect(const PrinterAddress& where, std::string_view path,
                                                 Nanoseconds timeout) override {
    auto socket = guarded([&] { return inner_.connect(where, path, timeout); });
    if (!socket) return socket;
    return std::make_unique<Socket>(*this, std::move(*socket));
  }
  Result<HttpReply> post(const PrinterAddress& where, std::string_view path, std::string_view type, std::string body,
                         Nanoseconds timeout) override {
    return guarded([&] { return inner_.post(where, path, type, std::move(body), timeout); });
  }
  [[nodiscard]] std::size_t calls() const { return calls_; }

 private:
  class Socket final : public MessageSocket {
   public:
    Socket(KillingNetwork& owner, std::unique_ptr<MessageSocket> inner) : owner_{owner}, inner_{std::move(inner)} {}
    Result<void> send(std::string_view text, Nanoseconds timeout) override {
      return owner_.guarded([&] { return inner_->send(text, timeout); });
    }
    Result<std::optional<std::string>> receive(Nanoseconds timeout) override {
      return owner_.guarded([&] { return inner_->receive(timeout); });
    }

   private:
    KillingNetwork& owner_;
    std::unique_ptr<MessageSocket> inner_;
  };
  PrinterNetwork& inner_;
  std::size_t at_;
  bool behind_;
  std::size_t calls_ = 0;
};

/// Nothing where it was killed.
std::optional<Result<WholePrintReport>> lived(WholePrintBench& bench, PrinterNetwork& network) {
  try {
    return bench.run_of(bench.job, bench.journal, network);
  } catch (const Killed&) {
    return std::nullopt;
  }
}

TEST(WholePrint, KilledAtAnyCallOfTheNetworkIsStartedOnceAndWatchedToItsEnd) {
  std::size_t calls = 0;
  {
    WholePrintBench bench;
    KillingNetwork network{*bench.network, SIZE_MAX, false};
    ASSERT_TRUE(lived(bench, network));
    calls = network.calls();
  }
  std::size_t kills = 0, decisions = 0, wrong_guesses = 0;
  for (const bool has_printed_before : {true, false})
    for (const bool behind : {false, true})
      for (std::size_t at = 0; at < calls; ++at) {
        WholePrintBench bench{has_printed_before};
        KillingNetwork network{*bench.network, at, behind};
        kills += lived(bench, network) ? 0U : 1U;
        bench.clock.advance(std::chrono::seconds{3});  // the printer goes on meanwhile
        Result<WholePrintReport> report = bench.run();
        ASSERT_TRUE(report) << report.error().what;
        if (report->outcome == WholePrintOutcome::AwaitingDecision) {
          ++decisions;
          wrong_guesses += has_printed_before ? 1U : 0U;
          bench.decide();
          report = bench.run();
          ASSERT_TRUE(report) << report.error().what;
        }
        EXPECT_EQ(report->outcome, WholePrintOutcome::Done) << at << ": " << report->message;
        EXPECT_EQ(bench.model.starts_of("part.goo"), 1U) << at;
        EXPECT_EQ(bench.model.layers_of("part.goo"), WholePrintBench::kLayers) << at;
        EXPECT_THAT(bench.model.violations(), testing::IsEmpty());
      }
  std::printf("  %zu kills, %zu decisions\n", kills, decisions);
  EXPECT_EQ(kills, 4 * calls);
  EXPECT_EQ(wrong_guesses, 0U) << "a printer that names its tasks needs no decision";
  EXPECT_LE(decisions, 4U) << "only where a printer has had no task before";
}

TEST(WholePrint, WhoseJournalIsDamagedStartsNothing) {
  WholePrintBench bench;
  KillingNetwork network{*bench.network, 40, true};
  ASSERT_FALSE(lived(bench, network));
  bench.journal[20] = '#';
  const std::size_t before = bench.model.interactions();
  const auto refused = bench.run();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotTrusted);
  EXPECT_EQ(bench.model.interactions(), before);
}

TEST(WholePrint, WithTheJournalOfAnotherPlanStartsNothing) {
  WholePrintBench bench;
  ASSERT_TRUE(bench.run());
  bench.job.plan.bytes[0] ^= std::byte{1};
  const auto refused = bench.run();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotTrusted);
}

TEST(WholePrint, IsNotWatchedAtAnotherPrinterThatHasItsAddressNow) {
  WholePrintBench bench;
  KillingNetwork network{*bench.network, 60, true};
  ASSERT_FALSE(lived(bench, network));
  ASSERT_EQ(bench.model.starts_of("part.goo"), 1U);
  SdcpModelOptions other = bench.printer;
  other.id = "00000000000000ff";
  SdcpModel another{other, bench.clock};
  const auto its_network = model_network(another, bench.clock);
  const auto refused = bench.run_of(bench.job, bench.journal, *its_network);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotTrusted);
  EXPECT_EQ(another.starts(), 0U);
  EXPECT_EQ(bench.run()->outcome, WholePrintOutcome::Done);
}

TEST(WholePrint, IsRecordedWithItsPrinterAndAsLitByIt) {
  WholePrintBench bench;
  ASSERT_TRUE(bench.run());
  const auto journal = PrinterJournal::open(memory_journal_file(bench.journal)).value();
  const std::string record = whole_print_record(journal);
  for (const std::string& part : {std::string{"by the printer"}, bench.printer.id, bench.printer.model,
                                  to_hex(bench.job.plan), bench.job.file.md5, std::string{"\"end\": \"done\""}})
    EXPECT_THAT(record, testing::HasSubstr(part));
}

TEST(WholePrint, WhoseLastLineIsTornGoesOnWhereTheOneBeforeEnds) {
  WholePrintBench bench;
  ASSERT_TRUE(bench.run());
  bench.journal.resize(bench.journal.size() - 10);
  const auto report = bench.run();
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done);
  EXPECT_EQ(bench.model.starts_of("part.goo"), 1U);
}

}  // namespace
}  // namespace telefab::fab
