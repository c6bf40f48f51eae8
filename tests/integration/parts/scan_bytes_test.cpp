// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_bytes.hpp"

#include <gtest/gtest.h>
#include <chrono>

#include <telefab/base/exit_code.hpp>
#include <telefab/test/scratch_folder.hpp>

// Files of any size as the programs read them. A file of holes takes no room.
namespace telefab::scan {
namespace {

constexpr std::size_t kLarge = std::size_t{100} << 20U;

std::filesystem::path file_of(const test::ScratchFolder& folder, std::size_t bytes) {
  const auto file = folder.path() / "scan.ply";
  std::ofstream{file} << "ply";
  std::filesystem::resize_file(file, bytes);
  return file;
}

TEST(ScanBytes, AreThoseOfTheFileWhateverItsSizeAndHowOftenTheyWereLetGo) {
  for (const std::size_t size : {std::size_t{1000}, kLarge}) {
    const test::ScratchFolder folder;
    const auto scan = ScanBytes::of(file_of(folder, size));
    ASSERT_TRUE(scan) << scan.error().what;
    ASSERT_EQ(scan->bytes().size(), size);
    const Digest digest = scan->digest();
    EXPECT_EQ(digest, digest_of(scan->bytes()));
    scan->let_go();
    EXPECT_EQ(scan->bytes()[1], std::byte{'l'});
    EXPECT_EQ(scan->bytes()[size - 1], std::byte{0});
  }
}

TEST(ScanBytes, EndTheProgramWithASentenceWhereALargeFileBecomesShorter) {
  const test::ScratchFolder folder;
  const auto file = file_of(folder, kLarge);
  EXPECT_EXIT(
      {
        const auto scan = ScanBytes::of(file);
        std::filesystem::resize_file(file, 10);
        std::exit(static_cast<int>(scan->bytes()[kLarge - 1]));
      },
      testing::ExitedWithCode(static_cast<int>(ExitCode::Storage)), "scan.ply became shorter while it was read");
}

TEST(ScanBytes, AreNotTrustedOfALargeFileThatWasWrittenToMeanwhile) {
  const test::ScratchFolder folder;
  const auto file = file_of(folder, kLarge);
  const auto scan = ScanBytes::of(file);
  ASSERT_TRUE(scan) << scan.error().what;
  EXPECT_TRUE(scan->is_unchanged());
  std::filesystem::last_write_time(file, std::filesystem::last_write_time(file) + std::chrono::seconds{1});
  const auto changed = scan->is_unchanged();
  ASSERT_FALSE(changed);
  EXPECT_EQ(changed.error().code, ErrorCode::Conflict);
}

TEST(ScanBytes, AreRefusedOfWhatIsNoFile) {
  const test::ScratchFolder folder;
  EXPECT_FALSE(ScanBytes::of(folder.path()));
  EXPECT_FALSE(ScanBytes::of(folder.path() / "nothing"));
}

}  // namespace
}  // namespace telefab::scan
