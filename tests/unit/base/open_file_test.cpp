// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <telefab/base/open_file.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab {
namespace {

OpenFile opened(const std::filesystem::path& path) { return OpenFile{::open(path.c_str(), O_RDONLY | O_CLOEXEC)}; }

TEST(Lock, IsHeldByOneAndFreeOnceItsFileIsClosed) {
  const test::ScratchFolder folder;
  OpenFile first = opened(folder.path());
  ASSERT_EQ(take_lock(first), 0);
  EXPECT_EQ(take_lock(first), 0) << "whoever holds it may ask again";
  const OpenFile second = opened(folder.path());
  EXPECT_EQ(take_lock(second), EWOULDBLOCK);
  { const OpenFile gone = std::move(first); }
  EXPECT_EQ(take_lock(second), 0);
}

TEST(Lock, SaysWhatIsWrongWithAFileThatIsNotOpen) { EXPECT_EQ(take_lock(OpenFile{}), EBADF); }

}  // namespace
}  // namespace telefab
