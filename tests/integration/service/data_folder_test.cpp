// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <telefab/service/data_folder.hpp>
#include <telefab/test/scratch_folder.hpp>

// Who may work in the folder of a daemon.

namespace telefab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

class DataFolderLock : public testing::Test {
 protected:
  test::ScratchFolder scratch_;
  std::filesystem::path folder_ = scratch_.path();
};

TEST_F(DataFolderLock, RefusesTheFolderOfADaemonThatWorks) {
  const auto first = DataFolder::open(folder_);
  ASSERT_TRUE(first) << first.error().what;
  const auto second = DataFolder::open(folder_);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::Conflict);
  EXPECT_THAT(second.error().what, HasSubstr("another daemon works in " + folder_.string()));
}

// Seen on a busy machine: the fab was killed right after it had begun the process that predicts what its masks cure.
TEST_F(DataFolderLock, WaitsForAChildThatAKilledDaemonHadJustBegun) {
  std::optional<DataFolder> killed = DataFolder::open(folder_).value();
  const pid_t child = ::fork();
  if (child == 0) {
    ::usleep(400'000);  // before it closes what it inherited
    ::_exit(0);
  }
  killed.reset();
  const auto from = Clock::now();
  const auto next = DataFolder::open(folder_);
  EXPECT_TRUE(next) << next.error().what;
  EXPECT_GE(Clock::now() - from, 100ms) << "the child did not hold the lock: nothing was tried";
  ::waitpid(child, nullptr, 0);
}

}  // namespace
}  // namespace telefab
