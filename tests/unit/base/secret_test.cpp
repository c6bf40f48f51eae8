// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>

namespace telefab {
namespace {

TEST(Secret, IsRefusedOnceOthersMayReadOrChangeIt) {
  const auto path = std::filesystem::temp_directory_path() / ("telefab-secret-" + std::to_string(::getpid()));
  std::filesystem::remove(path);
  ASSERT_TRUE(write_new_secret(path, "key"));
  EXPECT_EQ(*read_secret(path), "key");
  for (const mode_t mode : {0644U, 0604U, 0602U, 0620U, 0666U}) {
    ASSERT_EQ(::chmod(path.c_str(), mode), 0);
    const auto read = read_secret(path);
    ASSERT_FALSE(read) << mode;
    EXPECT_EQ(read.error().code, ErrorCode::NotTrusted);
    EXPECT_THAT(read.error().what, testing::HasSubstr("chmod 600"));
  }
  ASSERT_EQ(::chmod(path.c_str(), 0640), 0);
  EXPECT_TRUE(read_secret(path)) << "of the group of this process: a service reads root's key";
  EXPECT_EQ(write_new_secret(path, "another").error().code, ErrorCode::StorageFailed) << "it is there already";
  EXPECT_EQ(*read_secret(path), "key");
  std::filesystem::remove(path);
  EXPECT_EQ(read_secret(path).error().code, ErrorCode::NotFound);
}

}  // namespace
}  // namespace telefab
