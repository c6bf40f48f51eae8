// SPDX-License-Identifier: GPL-3.0-or-later
#include "watch_screen.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/base/text.hpp>

namespace telefab::client {
namespace {

using std::chrono::seconds;
using testing::Contains;
using testing::Each;
using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;

Job printing(std::uint32_t printed) {
  Job job;
  job.id = "j1";
  job.name = "statue.ply";
  job.machine = "machine-a";
  job.owner = "operator";
  job.state = JobState::Printing;
  job.counters = {500, 500, 500, 520, 520, printed, 1'000'000, 44'000};
  job.stages = {{JobStage::Slice, 0.9}};
  return job;
}

std::size_t characters(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

TEST(WatchScreen, ShowsEveryStageAndHowToLeave) {
  WatchHistory history;
  history.saw(printing(130), seconds{0}, "12:00:00");
  const auto lines = watch_screen(history, 100, 24);
  ASSERT_THAT(lines, SizeIs(24));
  EXPECT_THAT(lines, Contains(HasSubstr("statue.ply")));
  EXPECT_THAT(lines, Contains(HasSubstr("500 of 500, 1 s")));
  EXPECT_THAT(lines, Contains(HasSubstr("130 of 520")));
  EXPECT_THAT(lines, Contains(HasSubstr("12:00:00  printing")));
  EXPECT_EQ(lines.back(), "q leaves; the job goes on");
}

TEST(WatchScreen, FitsEverySizeOfATerminal) {
  WatchHistory history;
  history.saw(printing(130), seconds{0}, "12:00:00");
  for (const int columns : {1, 2, 7, 20, 43, 80, 300})
    for (const int rows : {1, 2, 5, 12, 100}) {
      const auto lines = watch_screen(history, columns, rows);
      ASSERT_THAT(lines, SizeIs(rows));
      for (const std::string& line : lines) EXPECT_LE(characters(line), static_cast<std::size_t>(columns)) << line;
    }
}

TEST(WatchScreen, ShowsTheWholeReasonOnAsManyLinesAsItNeeds) {
  Job job = printing(1);
  job.state = JobState::Failed;
  job.message =
      "statue.ply: the part is 90 x 90 x 750 mm, larger than machine-a: 260 x 160 mm platform, 200 mm travel; give "
      "--height-mm 160 or less, or --fit";
  WatchHistory history;
  history.saw(job, seconds{0}, "12:00:00");
  for (const int columns : {30, 43, 80}) {
    std::string all;
    for (const std::string& line : watch_screen(history, columns, 60)) {
      EXPECT_LE(characters(line), static_cast<std::size_t>(columns));
      all += line + ' ';
    }
    EXPECT_THAT(all, HasSubstr(job.message)) << columns;
  }
}

TEST(WatchScreen, LetsNoNameMoveTheCursor) {
  Job job = printing(1);
  job.name = "a\x1b[2Jb\r\n\x07\u202E\u009B.ply";
  job.message = "\x1b]0;title\x07";
  WatchHistory history;
  history.saw(job, seconds{0}, "12:00:00");
  for (const std::string& line : watch_screen(history, 100, 24)) EXPECT_TRUE(is_printable(line)) << line;
}

TEST(WatchScreen, CutsBetweenCharactersNotInThem) {
  Job job = printing(1);
  job.name = "\xC3\xA4\xC3\xB6\xC3\xBC\xC3\x9F.ply";
  WatchHistory history;
  history.saw(job, seconds{0}, "12:00:00");
  EXPECT_EQ(watch_screen(history, 11, 10).front(), "Telefab  \xC3\xA4\xC3\xB6");
}

TEST(WatchScreen, TellsTheTimeLeftByThePaceItSaw) {
  WatchHistory history;
  history.saw(printing(100), seconds{0}, "a");
  EXPECT_FALSE(history.seconds_left());
  history.saw(printing(120), seconds{200}, "b");
  ASSERT_TRUE(history.seconds_left());
  EXPECT_NEAR(*history.seconds_left(), 4000, 1e-6);
  EXPECT_THAT(watch_screen(history, 100, 24), Contains(HasSubstr("about 1 h 06 min left")));
}

TEST(WatchScreen, ListsChangesOfStateOnceAndKeepsTheNewest) {
  WatchHistory history;
  Job job = printing(1);
  for (int i = 0; i < 300; ++i) {
    job.state = i % 2 ? JobState::Paused : JobState::Printing;
    history.saw(job, seconds{i}, "t" + std::to_string(i));
    history.saw(job, seconds{i}, "again");
  }
  EXPECT_THAT(history.changes(), SizeIs(200));
  EXPECT_THAT(history.changes().back(), HasSubstr("t299"));
  EXPECT_THAT(history.changes(), Each(Not(HasSubstr("again"))));
}

TEST(ScreenUpdate, WritesChangedLinesOnly) {
  EXPECT_EQ(screen_update({"a", "b", "c"}, {"a", "b", "c"}), "");
  EXPECT_EQ(screen_update({"a", "b", "c"}, {"a", "x", "c"}), "\x1b[2;1Hx\x1b[K");
  EXPECT_EQ(screen_update({}, {"a"}), "\x1b[1;1Ha\x1b[K");
}

}  // namespace
}  // namespace telefab::client
