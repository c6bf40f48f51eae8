// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/signature.hpp>

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

TEST(Secret, IsReplacedWholeAndForItsOwnerAlone) {
  const auto folder = std::filesystem::temp_directory_path() / ("telefab-secrets-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  for (const char* text : {"first", "second"}) {
    ASSERT_TRUE(write_secret(folder / "tokens", text));
    EXPECT_EQ(*read_secret(folder / "tokens"), text);
    struct stat status {};
    ASSERT_EQ(::stat((folder / "tokens").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777U, 0600U);
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator{folder}, {}), 1);
  std::filesystem::remove_all(folder);
}

TEST(KeptKey, IsMadeOnceAndItsLostPublicHalfIsWrittenAgain) {
  const auto folder = std::filesystem::temp_directory_path() / ("telefab-kept-key-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const auto secret = folder / "sign.key", open = folder / "sign.pub";
  const auto text_of = [](const std::filesystem::path& path) {
    const auto bytes = read_file(path, 4096).value();
    return std::string{reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  };
  const std::string made = kept_ed25519_key(secret, open).value();
  const std::string public_half = text_of(open);
  std::filesystem::remove(open);
  EXPECT_EQ(kept_ed25519_key(secret, open).value(), made);
  EXPECT_EQ(text_of(open), public_half);
  EXPECT_TRUE(verify_ed25519(sign_ed25519(made, "layer").value(), "layer", text_of(open)));
  ASSERT_EQ(::chmod(secret.c_str(), 0644), 0);
  EXPECT_EQ(kept_ed25519_key(secret, open).error().code, ErrorCode::NotTrusted);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace telefab
