// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <telefab/base/digest.hpp>

namespace telefab {

TEST(Hasher, GivesTheDigestOfTheStandardsExample) {  // FIPS 180-4, example "abc"
  Hasher hasher;
  hasher.feed("abc");
  EXPECT_EQ(to_hex(hasher.digest()), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Hasher, DoesNotCareHowTheBytesWereSplit) {
  Hasher one;
  one.feed("telefab");
  Hasher two;
  two.feed("tele");
  (void)two.digest();
  two.feed("fab");
  EXPECT_EQ(one.digest(), two.digest());
}

TEST(Digest, ComesBackFromItsText) {
  const Digest digest = digest_of({});
  EXPECT_EQ(digest_from_hex(to_hex(digest)).value(), digest);
}

TEST(Digest, RefusesTextThatIsNoDigest) {
  EXPECT_FALSE(digest_from_hex("12"));
  EXPECT_FALSE(digest_from_hex(std::string(64, 'g')));
}

}  // namespace telefab
