// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <string>
#include <telefab/base/person_name.hpp>

namespace telefab {
namespace {

bool is_name(std::string_view text) { return is_person_name(text, "-_", 16); }

TEST(PersonName, HasLettersOfAnyScript) {
  for (const char* name : {"ada", "Ada-2", "Größe", "Łukasz", "Αθηνά", "Юрий", "李雷", "_x"})
    EXPECT_TRUE(is_name(name)) << name;
}

TEST(PersonName, HasNothingBlankInvisibleOrTurningAround) {
  for (const char* name : {"", "a b", "a\u00A0b", "a\u200Bb", "a\u202Eb", "a\u3000b", "a\u2066b", "a\uFEFFb", "a\tb",
                           "a\x1B[31m", "a/b", "a.b", "a,b", "a\nb", "a\xFF", "a\u2028b", "\u00D7", "a\U000E0041"})
    EXPECT_FALSE(is_name(name)) << name;
}

TEST(PersonName, HasALimitInBytes) {
  EXPECT_TRUE(is_name(std::string(16, 'a')));
  EXPECT_FALSE(is_name(std::string(17, 'a')));
  EXPECT_FALSE(is_name("ßßßßßßßßß"));
}

}  // namespace
}  // namespace telefab
