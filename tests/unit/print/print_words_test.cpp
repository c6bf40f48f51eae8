// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/test/layer_motions.hpp>

// Words of operators to a running print: none is answered before the journal has it, and none that was answered is
// forgotten, whatever happens behind it.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;

constexpr PixelSize kSize{4, 3};

class PlainMasks final : public MaskSource {
 public:
  Result<Mask> mask(LayerIndex layer) override {
    return Mask{kSize, std::vector<std::uint8_t>(12, static_cast<std::uint8_t>(layer.count() + 1))};
  }
};

/// A disk that may be full, and outlives the journal on it.
struct Disk {
  std::string text;
  bool is_full = false;
};
class DiskFile final : public JournalFile {
 public:
  explicit DiskFile(Disk& disk) : disk_{disk} {}
  Result<std::string> read_all() override { return disk_.text; }
  Result<void> append(std::string_view text) override {
    if (disk_.is_full) return fail(ErrorCode::StorageFailed, "the disk is full");
    disk_.text += text;
    return {};
  }
  Result<void> sync() override { return {}; }
  Result<void> truncate(std::uint64_t bytes) override {
    disk_.text.resize(bytes);
    return {};
  }
  Result<void> set_aside(std::string_view text) override {
    disk_.text = text;
    return {};
  }
  Result<void> reserve(std::uint64_t) override { return {}; }

 private:
  Disk& disk_;
};

enum class Word : std::uint8_t { Pause, Cancel };

struct Answer {
  int times = 0;
  std::optional<Result<void>> outcome;
  Nanoseconds at{};
};

struct Rig {
  Rig() {
    plan.job = "j1";
    plan.machine = "m";
    plan.mask_size = kSize;
    plan.z_travel_mm = 20;
    for (std::uint32_t i = 0; i < 5; ++i)
      plan.layers.push_back({LayerIndex{i}, 0.1 * (i + 1), 700ms,
                             digest_of(std::as_bytes(std::span{masks.mask(LayerIndex{i})->rows})),
                             test::every_step_and_tilt()});
  }
  /// A life of the site: prints until it is paused, cancelled or done; then the site stops.
  PrintRecord live(const PrintSink& sink) {
    PrintJournal journal = *PrintJournal::open(std::make_unique<DiskFile>(disk));
    PrintRunner runner{projector, stage, masks, journal, clock};
    PrintControl now;
    control = &now;
    std::stop_source site;
    const auto record = runner.run(
        plan, {}, now,
        [&](const PrintProgress& p) {
          if (p.phase == PrintPhase::Paused) site.request_stop();
          if (sink) sink(p);
        },
        site.get_token());
    EXPECT_TRUE(record) << record.error().what;
    now.close();
    return *record;
  }
  void give(Word word, Answer& answer) {
    auto kept = [this, &answer](const std::optional<Result<void>>& outcome) {
      ++answer.times;
      answer.outcome = outcome;
      answer.at = clock.now();
    };
    if (word == Word::Pause)
      control->pause("ana", std::move(kept));
    else
      control->cancel("ana", std::move(kept));
  }
  [[nodiscard]] std::size_t begun_after(Nanoseconds when) const {
    std::size_t n = 0;
    for (const LitSpan& lit : log.light()) n += lit.from > when;
    return n;
  }

  PrintPlan plan;
  PlainMasks masks;
  VirtualClock clock;
  MachineLog log;
  VirtualProjector projector{kSize, 0, clock, log};
  VirtualZStage stage{25, clock, log};
  Disk disk;
  PrintControl* control = nullptr;
};

constexpr PrintPhase kPhases[] = {PrintPhase::Homing,   PrintPhase::Lowering, PrintPhase::Settling,
                                  PrintPhase::Exposing, PrintPhase::Resting,  PrintPhase::Tilting,
                                  PrintPhase::Lifting,  PrintPhase::Draining};

TEST(PrintWords, ShowNoLightAfterAnAnsweredWordHoweverOftenTheSiteStartsAgain) {
  for (const Word word : {Word::Pause, Word::Cancel})
    for (const PrintPhase where : kPhases) {
      SCOPED_TRACE(name_of(where));
      Rig rig;
      Answer answer;
      rig.live([&](const PrintProgress& p) {
        if (p.phase == where && p.layer.count() == (where == PrintPhase::Homing ? 0u : 1u) && rig.control &&
            answer.times == 0)
          rig.give(word, answer);
      });
      ASSERT_EQ(answer.times, 1);
      ASSERT_TRUE(answer.outcome && *answer.outcome);
      for (int life = 0; life < 3; ++life) {
        const PrintRecord record = rig.live({});
        EXPECT_EQ(record.outcome, word == Word::Pause ? PrintOutcome::Faulted : PrintOutcome::Cancelled);
      }
      EXPECT_EQ(rig.begun_after(answer.at), 0u);
      EXPECT_EQ(rig.log.light_while_moving(), 0ns);
    }
}

TEST(PrintWords, RefuseAWordThatTheDiskCannotKeepAndGoDark) {
  for (const Word word : {Word::Pause, Word::Cancel})
    for (const PrintPhase where : kPhases) {
      SCOPED_TRACE(name_of(where));
      Rig rig;
      Answer answer;
      const PrintRecord record = rig.live([&](const PrintProgress& p) {
        if (p.phase != where || answer.times > 0) return;
        rig.disk.is_full = true;
        rig.give(word, answer);
      });
      ASSERT_EQ(answer.times, 1);
      ASSERT_TRUE(answer.outcome);
      ASSERT_FALSE(*answer.outcome);
      EXPECT_EQ(answer.outcome->error().code, ErrorCode::StorageFailed);
      EXPECT_NE(record.outcome, PrintOutcome::Done);
      EXPECT_EQ(rig.begun_after(answer.at), 0u);
    }
}

TEST(PrintWords, HandBackAWordThatCameTooLate) {
  Rig rig;
  rig.live({});
  PrintControl control;
  int untaken = 0;
  const auto count = [&](const std::optional<Result<void>>& outcome) { untaken += !outcome; };
  control.cancel("ana", count);
  control.close();
  control.pause("ana", count);
  EXPECT_EQ(untaken, 2);
}

TEST(PrintWords, KeepsWhoSaidWhatInTheRecord) {
  Rig rig;
  Answer answer;
  rig.live([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Settling && p.layer == LayerIndex{2}) rig.give(Word::Pause, answer);
  });
  {
    PrintJournal journal = *PrintJournal::open(std::make_unique<DiskFile>(rig.disk));
    ASSERT_TRUE(journal.write({JournalStep::Resumed, LayerIndex{2}, 7s, {}, "bob", {}, {}}));
  }
  const PrintRecord record = rig.live({});
  EXPECT_EQ(record.outcome, PrintOutcome::Done);
  ASSERT_EQ(record.orders.size(), 2u);
  EXPECT_EQ(record.orders[0].word + " " + record.orders[0].by, "pause-asked ana");
  EXPECT_EQ(record.orders[1].word + " " + record.orders[1].by, "resumed bob");
  EXPECT_EQ(*print_record_from_json(to_json(record)), record);
  EXPECT_THAT(compare(record, rig.plan), testing::IsEmpty());
  ASSERT_EQ(rig.log.light().size(), 5u);
}

}  // namespace
}  // namespace telefab::fab
