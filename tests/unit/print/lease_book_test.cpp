// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <telefab/fab/print/lease_book.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;

class LeaseBookTest : public testing::Test {
 protected:
  std::unique_ptr<LeaseBook> open() { return LeaseBook::open(folder(), clock).value(); }
  [[nodiscard]] std::filesystem::path folder() const { return scratch.path() / "fleet"; }
  static LeaveState leave(LeaseBook& book, std::string_view id) { return book.fence_of(id)->leave({}).state; }
  static FenceRefusal why(LeaseBook& book, std::string_view id) { return book.fence_of(id)->leave({}).why; }

  test::ScratchFolder scratch;
  VirtualClock clock;
};

TEST_F(LeaseBookTest, KnowsTheNewestAttemptOverRestarts) {
  {
    const auto book = open();
    ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
    ASSERT_TRUE(book->hold("j", 3, "j-a3", "a2"));
    ASSERT_TRUE(book->set_site("j", 3, "chicago"));
    ASSERT_TRUE(book->bind("j", 3));
  }
  const auto book = open();
  const FleetHold expected{"j", 3, "a2", "chicago", {{"j", 1}, {"j-a3", 3}}, true, HoldEnd::None, false};
  EXPECT_EQ(book->find("j"), expected);
  EXPECT_EQ(book->own("j")->attempt, 1U);
  EXPECT_FALSE(book->own("j")->is_newest());
  EXPECT_TRUE(book->own("j-a3")->is_newest());
  EXPECT_FALSE(book->own("k"));
}

TEST_F(LeaseBookTest, TakesNothingOfAnOlderAttempt) {
  const auto book = open();
  ASSERT_TRUE(book->hold("j", 3, "j-a3", "a2"));
  for (const auto& refused :
       {book->hold("j", 2, "j-a2", "a1"), book->bind("j", 2), book->set_site("j", 2, "chicago")}) {
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::Conflict);
  }
  EXPECT_FALSE(book->own("j-a2"));
}

TEST_F(LeaseBookTest, TakesAJobFromOneScanSiteAlone) {
  const auto book = open();
  ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
  ASSERT_TRUE(book->set_site("j", 1, "chicago"));
  EXPECT_TRUE(book->set_site("j", 1, "chicago"));
  EXPECT_FALSE(book->set_site("j", 1, "boston"));
}

TEST_F(LeaseBookTest, GivesLeaveOnceTheFleetHasBoundTheAttempt) {
  const auto book = open();
  ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
  book->extend("j", 1, clock.now() + 10s);
  int asked = 0;
  book->on_asked([&] { ++asked; });
  EXPECT_EQ(leave(*book, "j"), LeaveState::Awaited);
  EXPECT_EQ(leave(*book, "j"), LeaveState::Awaited);
  EXPECT_EQ(asked, 1) << "asked once";
  ASSERT_EQ(book->asked().size(), 1U);
  ASSERT_TRUE(book->bind("j", 1));
  EXPECT_TRUE(book->asked().empty());
  EXPECT_EQ(leave(*book, "j"), LeaveState::Given);
}

TEST_F(LeaseBookTest, LightsNothingUnboundWhoseLeaseIsNotShownToHold) {
  const auto book = open();
  ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
  EXPECT_EQ(why(*book, "j"), FenceRefusal::LeaseEnded) << "of an earlier life";
  book->extend("j", 1, clock.now() + 10s);
  clock.sleep_for(10s);
  EXPECT_EQ(why(*book, "j"), FenceRefusal::LeaseEnded);
  book->extend("j", 1, clock.now() + 10s);
  EXPECT_EQ(leave(*book, "j"), LeaveState::Awaited);
  book->withdraw("j", 1, FenceRefusal::LeaseEnded);
  EXPECT_EQ(why(*book, "j"), FenceRefusal::LeaseEnded);
}

TEST_F(LeaseBookTest, LetsABoundJobGoOnWithoutTheFleetAlsoOverARestart) {
  {
    const auto book = open();
    ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
    ASSERT_TRUE(book->bind("j", 1));
    clock.sleep_for(24h);
    EXPECT_EQ(leave(*book, "j"), LeaveState::Given);
  }
  EXPECT_EQ(leave(*open(), "j"), LeaveState::Given);
}

TEST_F(LeaseBookTest, StopsABoundJobThatTheFleetGaveAway) {
  const auto book = open();
  ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
  ASSERT_TRUE(book->bind("j", 1));
  book->withdraw("j", 1, FenceRefusal::Superseded);
  EXPECT_EQ(why(*book, "j"), FenceRefusal::Superseded);
  ASSERT_TRUE(book->end("j", 1, HoldEnd::Cancelled));
  EXPECT_EQ(why(*open(), "j"), FenceRefusal::Superseded) << "what has ended stays dark";
}

TEST_F(LeaseBookTest, NeverLightsAnOlderAttemptAlsoOneThatWasBound) {
  const auto book = open();
  ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
  const auto fence = book->fence_of("j");
  ASSERT_TRUE(book->bind("j", 1));
  EXPECT_EQ(fence->leave({}).state, LeaveState::Given);
  ASSERT_TRUE(book->hold("j", 2, "j-a2", "a1"));
  EXPECT_EQ(fence->leave({}).why, FenceRefusal::Superseded);
  EXPECT_EQ(book->fence_of("j-a2")->attempt(), 2U);
  EXPECT_NE(leave(*book, "j-a2"), LeaveState::Given) << "its own binding is another one";
}

TEST_F(LeaseBookTest, FencesNoJobThatIsNoneOfAFleet) {
  const auto book = open();
  EXPECT_EQ(book->fence_of("x"), nullptr);
  EXPECT_EQ(book->leave("x").state, LeaveState::Given);
  EXPECT_FALSE(std::filesystem::exists(folder())) << "nothing is written without a fleet";
}

TEST_F(LeaseBookTest, LightsNothingOfAJobWhoseRecordCannotBeRead) {
  {
    const auto book = open();
    ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
    ASSERT_TRUE(book->bind("j", 1));
  }
  std::ofstream{folder() / "j.json"} << "{\"format\":\"telefab-fleet-hold-1\",\"job\"";
  const auto book = open();
  ASSERT_EQ(book->unreadable().size(), 1U);
  EXPECT_THAT(book->unreadable().front(), testing::HasSubstr("j.json"));
  EXPECT_EQ(why(*book, "j"), FenceRefusal::Superseded);
  EXPECT_FALSE(book->hold("j", 2, "j-a2", "a1"));
}

TEST_F(LeaseBookTest, RemembersWhatTheFleetIsToHear) {
  {
    const auto book = open();
    ASSERT_TRUE(book->hold("j", 1, "j", "a1"));
    ASSERT_TRUE(book->end("j", 1, HoldEnd::Done));
    ASSERT_TRUE(book->end("j", 1, HoldEnd::Cancelled)) << "the first end counts";
  }
  const auto book = open();
  EXPECT_EQ(book->find("j")->end, HoldEnd::Done);
  EXPECT_FALSE(book->find("j")->is_reported);
  ASSERT_TRUE(book->set_reported("j", 1));
  EXPECT_TRUE(open()->find("j")->is_reported);
}

TEST_F(LeaseBookTest, ChangesNothingThatItCannotKeep) {
  const auto book = open();
  std::ofstream{folder()} << "a file where the folder should be";
  const auto kept = book->hold("j", 1, "j", "a1");
  ASSERT_FALSE(kept);
  EXPECT_EQ(kept.error().code, ErrorCode::StorageFailed);
  EXPECT_FALSE(book->find("j"));
}

}  // namespace
}  // namespace telefab::fab
