// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <fstream>
#include <iterator>
#include <telefab/base/file.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/transfer/second_name.hpp>

namespace telefab {
namespace {

class SecondNameTest : public testing::Test {
 protected:
  void SetUp() override {
    text.resize(3'000'003, 'x');  // a few blocks and a bit
    ASSERT_TRUE(write_file_atomically(from, text));
  }
  [[nodiscard]] std::ptrdiff_t files() const {
    return std::distance(std::filesystem::directory_iterator{scratch.path()}, std::filesystem::directory_iterator{});
  }
  test::ScratchFolder scratch;
  std::string text;
  std::filesystem::path from = scratch.path() / "from", to = scratch.path() / "to";
};

TEST_F(SecondNameTest, IsOfTheSameFile) {
  EXPECT_TRUE(give_second_name(from, to).value());
  EXPECT_TRUE(std::filesystem::equivalent(from, to));
  EXPECT_EQ(give_second_name(from, to).error().code, ErrorCode::StorageFailed) << "what is there stays";
}

TEST_F(SecondNameTest, IsNoFailureWhereTheFileSystemKnowsNone) {
  for (const int error : {EXDEV, EPERM, EMLINK, EOPNOTSUPP, ENOSYS})
    EXPECT_FALSE(give_second_name(from, to, [&](const char*, const char*) { return error; }).value()) << error;
  const auto full = give_second_name(from, to, [](const char*, const char*) { return ENOSPC; });
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().code, ErrorCode::StorageFailed);
  EXPECT_EQ(give_second_name(scratch.path() / "none", to).error().code, ErrorCode::NotFound);
}

TEST_F(SecondNameTest, IsMadeGoodByACopyThatIsWholeOrNotThere) {
  ASSERT_TRUE(copy_whole(from, to, {}));
  const auto bytes = read_file(to, 1U << 30U).value();
  EXPECT_EQ((std::string{reinterpret_cast<const char*>(bytes.data()), bytes.size()}), text);
  std::filesystem::remove(to);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(copy_whole(from, to, stop.get_token()).error().code, ErrorCode::Cancelled);
  EXPECT_EQ(copy_whole(from, scratch.path() / "nowhere" / "to", {}).error().code, ErrorCode::NotFound);
  EXPECT_EQ(files(), 1) << "nothing is left of a copy that failed";
}

}  // namespace
}  // namespace telefab
