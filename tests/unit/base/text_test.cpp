// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <string>
#include <telefab/base/text.hpp>

namespace telefab {
namespace {

TEST(PrintableText, TakesNamesOfAllLanguages) {
  for (const char* name : {"statue.xyz", "Größe.xyz", "部品.xyz", "Café (copie).xyz", "Żółw.ply", "деталь.pcd",
                           "🦕.stl", "جزء.xyz", "a b'c\"d.xyz", ""}) {
    EXPECT_TRUE(is_printable(name)) << name;
    EXPECT_EQ(to_printable(name), name);
  }
}

TEST(PrintableText, RefusesWhatSteersATerminalOrReorders) {
  for (const std::string& text :
       {std::string{"\x1b[2J"}, std::string{"a\nb"}, std::string{"a\rb"}, std::string{"a\0b", 3}, std::string{"\x7f"},
        std::string{"\xC2\x9B"
                    "31m"},
        std::string{"\xE2\x80\xAE"
                    "txt.exe"},
        std::string{"\xE2\x80\xA8"}, std::string{"\xE2\x81\xA6"}, std::string{"\xD8\x9C"}})
    EXPECT_FALSE(is_printable(text)) << to_printable(text);
}

TEST(PrintableText, RefusesBrokenUtf8) {
  for (const char* text : {"\xC3", "\x80", "\xC0\xAF", "\xE0\x80\xAF", "\xED\xA0\x80", "\xF4\x90\x80\x80",
                           "\xF8\x88\x80\x80\x80", "\xE2\x82",
                           "Gr\xF6\xDF"
                           "e.xyz"}) {
    EXPECT_FALSE(is_printable(text));
    EXPECT_TRUE(is_printable(to_printable(text)));
  }
}

TEST(PrintableText, KeepsWhatIsFineAndLineBreaksAsSpaces) {
  EXPECT_EQ(to_printable("Größe\n\x1b[31mrot\xFF"), "Größe ?[31mrot?");
}

TEST(PrintableText, IsAlwaysPrintableAfterwards) {
  std::uint64_t state = 7;
  for (int round = 0; round < 20000; ++round) {
    std::string text;
    for (int i = 0; i < 6; ++i) {
      state = state * 6364136223846793005ULL + 1442695040888963407ULL;
      text += static_cast<char>(state >> 56U);
    }
    ASSERT_TRUE(is_printable(to_printable(text)));
  }
}

TEST(FileName, IsPlainAndInAnyLanguage) {
  for (const char* name : {"a", "Größe.xyz", "部品.xyz", "Café (copie).xyz"}) EXPECT_TRUE(is_file_name(name)) << name;
  EXPECT_TRUE(is_file_name(std::string(255, 'a')));
  for (const std::string& name : {std::string{}, std::string{".hidden"}, std::string{".."}, std::string{"a/b"},
                                  std::string{"a\\b"}, std::string{"a\nb"},
                                  std::string{"Gr\xF6\xDF"
                                              "e.xyz"},
                                  std::string(256, 'a')})
    EXPECT_FALSE(is_file_name(name)) << to_printable(name);
}

}  // namespace
}  // namespace telefab
