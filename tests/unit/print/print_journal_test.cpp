// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <telefab/base/digest.hpp>
#include <telefab/fab/print/print_journal.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
namespace fs = std::filesystem;

JournalEntry line(JournalStep step, std::uint32_t layer) {
  JournalEntry e;
  e.step = step;
  e.layer = LayerIndex{layer};
  e.wall = Nanoseconds{layer + 1};
  e.made.index = e.layer;
  return e;
}

/// A file in memory whose bytes the test may change, and that fails on request.
class TestFile final : public JournalFile {
 public:
  struct State {
    std::string text, aside;
    int fail_appends_after = -1;  ///< bytes of an append that still go in, then the disk is full; below 0: never
    bool may_truncate = true;
  };
  explicit TestFile(State& state) : state_{state} {}
  Result<std::string> read_all() override { return state_.text; }
  Result<void> append(std::string_view text) override {
    if (state_.fail_appends_after < 0) {
      state_.text += text;
      return {};
    }
    state_.text += text.substr(0, static_cast<std::size_t>(state_.fail_appends_after));
    return fail(ErrorCode::StorageFailed, "the disk is full");
  }
  Result<void> sync() override { return {}; }
  Result<void> truncate(std::uint64_t bytes) override {
    if (!state_.may_truncate) return fail(ErrorCode::StorageFailed, "no");
    state_.text.resize(bytes);
    return {};
  }
  Result<void> set_aside(std::string_view text) override {
    state_.aside = state_.text;
    state_.text = text;
    return {};
  }
  Result<void> reserve(std::uint64_t) override { return {}; }

 private:
  State& state_;
};

PrintJournal open(TestFile::State& state) { return *PrintJournal::open(std::make_unique<TestFile>(state)); }

/// Four layers printed, the fifth begun.
std::string four_layers_and_a_bit() {
  TestFile::State state;
  PrintJournal journal = open(state);
  EXPECT_TRUE(journal.write(line(JournalStep::Approved, 0)));
  EXPECT_TRUE(journal.write(line(JournalStep::Planned, 0)));
  for (std::uint32_t k = 0; k < 4; ++k)
    for (const JournalStep step :
         {JournalStep::Ready, JournalStep::Exposing, JournalStep::Exposed, JournalStep::Lifted})
      EXPECT_TRUE(journal.write(line(step, k)));
  EXPECT_TRUE(journal.write(line(JournalStep::Ready, 4)));
  EXPECT_THAT(journal.gaps(), IsEmpty());
  return state.text;
}

TEST(PrintJournal, NeverForgetsALayerBehindAChangedBit) {
  const std::string sound = four_layers_and_a_bit();
  for (std::size_t at = 0; at < sound.size(); ++at) {
    TestFile::State state{sound, {}};
    state.text[at] = static_cast<char>(state.text[at] ^ 0x10);
    PrintJournal journal = open(state);
    SCOPED_TRACE(at);
    ASSERT_EQ(state.text.size(), sound.size()) << "damage is never cut";
    ASSERT_FALSE(journal.damage().empty());
    ASSERT_FALSE(journal.gaps().empty());
    const ResumePoint point = journal.resume_point();
    ASSERT_TRUE(point.next == LayerIndex{4}) << point.next.count();
    ASSERT_EQ(journal.write(line(JournalStep::Exposing, 4)).error().code, ErrorCode::NotTrusted)
        << "nothing is written behind damage, so nothing is lit";
  }
}

TEST(PrintJournal, CutsATornTailAndGoesOn) {
  const std::string sound = four_layers_and_a_bit();
  TestFile::State state{sound.substr(0, sound.size() - 9), {}};
  PrintJournal journal = open(state);
  EXPECT_THAT(journal.damage(), IsEmpty());
  EXPECT_EQ(journal.resume_point(), (ResumePoint{LayerIndex{4}, false}));
  ASSERT_TRUE(journal.write(line(JournalStep::Exposing, 4)));
  EXPECT_THAT(open(state).damage(), IsEmpty());
  EXPECT_EQ(open(state).resume_point(), (ResumePoint{LayerIndex{4}, true}));
}

TEST(PrintJournal, PutsTheLayersBehindADamagedEndInQuestion) {
  std::string text = four_layers_and_a_bit();
  const std::size_t from = text.find("\"exposing\",\"layer\":2");
  for (std::size_t at = from; at < text.size(); ++at)
    if (text[at] != '\n') text[at] = '~';
  TestFile::State state{text, {}};
  const ResumePoint point = open(state).resume_point();
  EXPECT_TRUE(point.maybe_exposed);
  EXPECT_EQ(point.next, LayerIndex{2});
  EXPECT_GE(point.next.count() + point.in_question, 4u) << "all that may have been exposed";
}

TEST(PrintJournal, SetsDamageAsideAndKeepsWhatWasSoundAndTheWordAboutIt) {
  std::string text = four_layers_and_a_bit();
  text[text.find("\"exposed\",\"layer\":1") + 2] = '?';
  TestFile::State state{text, {}};
  PrintJournal journal = open(state);
  JournalEntry word = line(JournalStep::Resumed, 4);
  word.by = "ana";
  ASSERT_TRUE(journal.set_aside("ana", Nanoseconds{99}, {word}));
  EXPECT_EQ(state.aside, text);
  for (const PrintJournal& now : {std::move(journal), open(state)}) {
    EXPECT_THAT(now.damage(), IsEmpty());
    EXPECT_EQ(now.resume_point(), (ResumePoint{LayerIndex{4}, false}));
    EXPECT_EQ(now.order().order, Order::GoOn);
    EXPECT_EQ(now.orders().at(1).word, "set-aside");
    EXPECT_THAT(now.gaps(), testing::Contains(HasSubstr("are lost"))) << "the record still says so";
  }
}

TEST(PrintJournal, WritesNothingBehindAWriteThatFailedHalfway) {
  const std::string sound = four_layers_and_a_bit();
  for (const bool may_truncate : {true, false}) {
    TestFile::State state{sound, {}, 20, may_truncate};
    PrintJournal journal = open(state);
    EXPECT_EQ(journal.write(line(JournalStep::Exposing, 4)).error().code, ErrorCode::StorageFailed);
    state.fail_appends_after = -1;
    EXPECT_EQ(journal.write(line(JournalStep::Exposing, 4)).has_value(), may_truncate);
    state.may_truncate = true;
    EXPECT_THAT(open(state).damage(), IsEmpty());
  }
}

TEST(PrintJournal, AnnouncesNoLightAgainstTheStandingOrder) {
  for (const JournalStep against : {JournalStep::PauseAsked, JournalStep::CancelAsked}) {
    TestFile::State state{four_layers_and_a_bit(), {}};
    PrintJournal journal = open(state);
    ASSERT_TRUE(journal.write(line(against, 4)));
    EXPECT_EQ(journal.write(line(JournalStep::Exposing, 4)).error().code, ErrorCode::Conflict);
    ASSERT_TRUE(journal.write(line(JournalStep::Resumed, 4)));
    EXPECT_EQ(journal.write(line(JournalStep::Exposing, 4)).has_value(), against == JournalStep::PauseAsked);
  }
}

TEST(PrintJournal, FindsLayersThatWereDoubledSkippedOrExposedInQuestion) {
  using enum JournalStep;
  const auto gaps = [](const std::vector<std::pair<JournalStep, std::uint32_t>>& lines) {
    TestFile::State state;
    PrintJournal journal = open(state);
    for (const auto& [step, layer] : lines) EXPECT_TRUE(journal.write(line(step, layer)));
    return journal.gaps();
  };
  EXPECT_THAT(gaps({{Exposing, 0}, {Exposed, 0}, {Exposing, 0}}), testing::ElementsAre(HasSubstr("comes again")));
  EXPECT_THAT(gaps({{Exposing, 0}, {Exposed, 0}, {Exposing, 3}}), testing::ElementsAre(HasSubstr("missing")));
  EXPECT_THAT(gaps({{Exposing, 0}, {Exposing, 0}}), testing::ElementsAre(HasSubstr("nobody had decided")));
  EXPECT_THAT(gaps({{Exposing, 0}, {DecidedExposeAgain, 0}, {Ready, 0}, {Exposing, 0}, {Exposed, 0}}), IsEmpty());
  EXPECT_THAT(gaps({{Exposing, 0}, {NotExposed, 0}, {Exposing, 0}, {Exposed, 0}, {Passed, 1}, {Ready, 2}}), IsEmpty());
}

TEST(PrintJournal, ReadsAJournalOfAnOlderVersionAndGoesOnInIt) {
  std::string old;
  for (const char* body : {R"({"step":"planned","layer":0,"wall_ns":5,"plan_sha256":"@"})",
                           R"({"step":"exposing","layer":0,"wall_ns":6})"}) {
    std::string text = body;
    if (const auto at = text.find('@'); at != std::string::npos) text.replace(at, 1, std::string(64, '0'));
    old += to_hex(digest_of(std::as_bytes(std::span{text}))).substr(0, 16) + " " + text + "\n";
  }
  TestFile::State state{old, {}};
  PrintJournal journal = open(state);
  EXPECT_THAT(journal.damage(), IsEmpty());
  EXPECT_EQ(journal.resume_point(), (ResumePoint{LayerIndex{0}, true}));
  EXPECT_EQ(journal.order().order, Order::None);
  ASSERT_TRUE(journal.write(line(JournalStep::DecidedExposeAgain, 0)));
  EXPECT_THAT(open(state).damage(), IsEmpty());
  EXPECT_EQ(open(state).resume_point(), (ResumePoint{LayerIndex{0}, false}));
  state.text[25] ^= 1;
  EXPECT_FALSE(open(state).damage().empty());
}

TEST(PrintJournal, KeepsADamagedFileBesideTheSoundOne) {
  const fs::path folder = fs::path{testing::TempDir()} / "telefab-journal-aside";
  fs::remove_all(folder);
  fs::create_directories(folder);
  std::string text = four_layers_and_a_bit();
  text[text.size() / 2] ^= 1;
  std::ofstream{folder / "journal", std::ios::binary} << text;
  {
    auto journal = PrintJournal::open(*open_journal_file(folder / "journal"));
    ASSERT_TRUE(journal);
    ASSERT_TRUE(journal->set_aside("ana", Nanoseconds{1}, {}));
    ASSERT_TRUE(journal->reserve(LayerIndex{10}));
    ASSERT_TRUE(journal->write(line(JournalStep::Resumed, 4)));
  }
  std::ifstream aside{folder / "journal.damaged-1", std::ios::binary};
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>{aside}, {}), text);
  auto again = PrintJournal::open(*open_journal_file(folder / "journal"));
  ASSERT_TRUE(again);
  EXPECT_THAT(again->damage(), IsEmpty());
  EXPECT_EQ(again->order().order, Order::GoOn);
  fs::remove_all(folder);
}

TEST(PrintJournal, KeepsTheAttemptOfAStartAndOfEachAnnouncedLayer) {
  std::string bytes;
  {
    auto journal = PrintJournal::open(memory_journal_file(bytes)).value();
    EXPECT_EQ(journal.attempt(), 0U);
    for (const JournalStep step : {JournalStep::Planned, JournalStep::Exposing}) {
      JournalEntry entry = line(step, 0);
      entry.attempt = 3;
      ASSERT_TRUE(journal.write(entry));
    }
  }
  const auto again = PrintJournal::open(memory_journal_file(bytes)).value();
  EXPECT_EQ(again.attempt(), 3U);
  EXPECT_EQ(again.entries().back().attempt, 3U);
}

TEST(PrintJournal, TakesNoStartAndNoLayerOfAnOlderAttempt) {
  auto journal = PrintJournal::open(memory_journal_file()).value();
  const auto entry = [](JournalStep step, std::uint32_t attempt) {
    JournalEntry made = line(step, 0);
    made.attempt = attempt;
    return made;
  };
  ASSERT_TRUE(journal.write(entry(JournalStep::Planned, 3)));
  for (const std::uint32_t older : {0U, 2U})
    for (const JournalStep step : {JournalStep::Planned, JournalStep::Exposing}) {
      const auto refused = journal.write(entry(step, older));
      ASSERT_FALSE(refused);
      EXPECT_EQ(refused.error().code, ErrorCode::Conflict);
    }
  EXPECT_TRUE(journal.write(line(JournalStep::NotExposed, 0))) << "what says that nothing was lit is always kept";
  EXPECT_TRUE(journal.write(entry(JournalStep::Exposing, 3)));
  EXPECT_TRUE(journal.write(entry(JournalStep::Planned, 4)));
}

TEST(PrintJournal, WithoutAnAttemptIsWrittenAsItEverWas) {
  std::string bytes;
  auto journal = PrintJournal::open(memory_journal_file(bytes)).value();
  ASSERT_TRUE(journal.write(line(JournalStep::Planned, 0)));
  EXPECT_EQ(bytes.find("attempt"), std::string::npos);
}

}  // namespace
}  // namespace telefab::fab
