// SPDX-License-Identifier: GPL-3.0-or-later
#include "usage_error.hpp"

#include <gmock/gmock.h>

namespace telefab {
namespace {

using testing::HasSubstr;
using Words = std::vector<std::string>;

const Words kVerbs{"slice", "inspect", "register", "serve", "cancel", "machines"};
const Words kOptions{"--height-mm", "--layer-mm", "--machine", "--machines", "--fit", "--up"};

TEST(UsageError, FindsTheNameBehindASlipOfTheKeys) {
  EXPECT_EQ(meant("slise", kVerbs), "slice");
  EXPECT_EQ(meant("cancle", kVerbs), "cancel");
  EXPECT_EQ(meant("inpsect", kVerbs), "inspect");
  EXPECT_EQ(meant("--machnie", kOptions), "--machine");
  EXPECT_EQ(meant("--ifit", kOptions), "--fit");
}

TEST(UsageError, FindsTheNameThatLacksItsEnd) {
  EXPECT_EQ(meant("--height", kOptions), "--height-mm");
  EXPECT_EQ(meant("reg", kVerbs), "register");
}

TEST(UsageError, GuessesNothingFarFromAnyName) {
  for (const char* word : {"dragon", "x", "-", "--", "", "--quality"}) {
    EXPECT_EQ(meant(word, kVerbs), std::nullopt) << word;
    EXPECT_EQ(meant(word, kOptions), std::nullopt) << word;
  }
}

TEST(UsageError, SaysWhichWordIsWrongAndWhatWasMeant) {
  EXPECT_EQ(unknown_verb("telefab-scan", "slise", kVerbs), "telefab-scan has no verb 'slise'; did you mean 'slice'?");
  EXPECT_EQ(unknown_verb("telefab-scan", "dragon.ply", kVerbs), "telefab-scan has no verb 'dragon.ply'");
  EXPECT_EQ(unexpected_word("--height=75", kOptions), "there is no option --height; did you mean --height-mm?");
  EXPECT_THAT(unexpected_word("scan.ply", kOptions), HasSubstr("one word too many"));
}

TEST(UsageError, SendsAnOptionBehindTheVerb) {
  EXPECT_EQ(option_before_verb("telefab", "--site"), "options stand behind the verb: telefab VERB --site");
}

TEST(UsageError, NamesTheNumberThatADecimalCommaStandsFor) {
  EXPECT_THAT(decimal_comma(Words{"a.ply", "--height-mm", "7,5"}).value_or(""), HasSubstr("7.5"));
  EXPECT_THAT(decimal_comma(Words{"--height-mm=-7,25"}).value_or(""), HasSubstr("-7.25"));
  EXPECT_EQ(decimal_comma(Words{"--crop", "0,0,0,1,1,1", "--height-mm", "x"}), std::nullopt);
}

}  // namespace
}  // namespace telefab
