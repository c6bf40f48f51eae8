// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cerrno>
#include <filesystem>
#include <telefab/base/file.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab {
namespace {

class FileTest : public testing::Test {
 protected:
  test::ScratchFolder scratch;
  std::filesystem::path folder = scratch.path();
};
using ReadFile = FileTest;
using WriteFileAtomically = FileTest;

TEST_F(WriteFileAtomically, LeavesOnlyTheFileAndItsBytes) {
  ASSERT_TRUE(write_file_atomically(folder / "a", "first"));
  ASSERT_TRUE(write_file_atomically(folder / "a", "second"));
  const auto bytes = read_file(folder / "a", 100);
  ASSERT_TRUE(bytes);
  EXPECT_EQ(std::string(reinterpret_cast<const char*>(bytes->data()), bytes->size()), "second");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator{folder}, {}), 1);
}

TEST_F(WriteFileAtomically, WritesIntoAHiddenFileFirst) {
  const auto temporary = make_temporary_beside(folder / "report.json");
  ASSERT_TRUE(temporary) << temporary.error().what;
  EXPECT_TRUE(temporary->filename().string().starts_with(".report.json."));
  EXPECT_EQ(temporary->parent_path(), folder);
}

TEST_F(WriteFileAtomically, LeavesTheModeToTheUmask) {
  for (const mode_t mask : {0022U, 0027U, 0077U}) {
    const mode_t before = ::umask(mask);
    const auto path = folder / std::to_string(mask);
    EXPECT_TRUE(write_file_atomically(path, "text"));
    ::umask(before);
    struct stat status {};
    ASSERT_EQ(::stat(path.c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777U, 0666U & ~mask);
  }
}

TEST_F(WriteFileAtomically, NamesTheFolderThatIsNotThere) {
  const auto done = write_file_atomically(folder / "no" / "a", "text");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::NotFound);
}

TEST(FailSystem, TakesAReadOnlyDiskForOneThatFailsAndNotForAMatterOfPermission) {
  const auto read_only = fail_system("write", "/data/journal", EROFS);
  EXPECT_EQ(read_only.value().code, ErrorCode::StorageFailed);
  EXPECT_NE(read_only.value().what.find("cannot write /data/journal: its file system is read-only"), std::string::npos);
  for (const int error : {EIO, ENOSPC, EDQUOT, ESTALE})
    EXPECT_EQ(fail_system("write", "a", error).value().code, ErrorCode::StorageFailed) << error;
  for (const int error : {EACCES, EPERM})
    EXPECT_EQ(fail_system("write", "a", error).value().code, ErrorCode::NotPermitted) << error;
  for (const int error : {ENOENT, ENOTDIR})
    EXPECT_EQ(fail_system("write", "a", error).value().code, ErrorCode::NotFound) << error;
}

TEST_F(WriteFileAtomically, PutsNothingInThePlaceOfAFolderOrDevice) {
  ASSERT_TRUE(std::filesystem::create_directory(folder / "kept"));
  EXPECT_EQ(write_file_atomically(folder / "kept", "text").error().code, ErrorCode::InvalidInput);
  std::filesystem::create_symlink("/dev/null", folder / "device");
  EXPECT_EQ(write_file_atomically(folder / "device", "text").error().code, ErrorCode::InvalidInput);
  EXPECT_TRUE(std::filesystem::is_symlink(folder / "device"));
}

TEST_F(ReadFile, RefusesAFolderAMissingFileAndAFileAboveTheLimit) {
  EXPECT_EQ(read_file(folder, 100).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(read_file(folder / "none", 100).error().code, ErrorCode::NotFound);
  ASSERT_TRUE(write_file_atomically(folder / "a", "12345"));
  EXPECT_EQ(read_file(folder / "a", 4).error().code, ErrorCode::TooLarge);
}

}  // namespace
}  // namespace telefab
