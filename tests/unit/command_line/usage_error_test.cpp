// SPDX-License-Identifier: GPL-3.0-or-later
#include "usage_error.hpp"

#include <gmock/gmock.h>

namespace telefab {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using Words = std::vector<std::string>;

const Words kVerbs{"slice", "inspect", "register", "serve", "cancel", "machines"};
const Words kOptions{"--height-mm", "--layer-mm", "--machine", "--machines", "--fit", "--up"};

TEST(UsageError, SaysWhichWordIsWrongAndWhatWasMeant) {
  EXPECT_EQ(unknown_verb("telefab-scan", "slise", kVerbs), "there is no verb 'slise'; did you mean 'slice'?");
  EXPECT_THAT(unknown_verb("telefab-scan", "dragon.ply", kVerbs),
              AllOf(HasSubstr("no verb 'dragon.ply'"), HasSubstr("telefab-scan VERB"), HasSubstr("slice, inspect")));
  EXPECT_EQ(unexpected_word("--height=75", kOptions), "there is no option --height; did you mean --height-mm?");
  EXPECT_THAT(unexpected_word("scan.ply", kOptions), HasSubstr("one word too many"));
}

TEST(UsageError, SendsAnOptionBehindTheVerb) {
  EXPECT_EQ(option_before_verb("telefab", "--site"), "options stand behind the verb: telefab VERB --site");
}

TEST(UsageError, TakesEveryNumberOfItsKind) {
  for (const char* word : {"7", "-7.5", "+0.25", "1e-3", ".5", "0"})
    EXPECT_EQ(number_problem(word, NumberKind::Any), "") << word;
  for (const char* word : {"7", "-7", "0"}) EXPECT_EQ(number_problem(word, NumberKind::Whole), "") << word;
  EXPECT_EQ(number_problem("12", NumberKind::Counting), "");
}

TEST(UsageError, RefusesWhatIsNoNumberOfTheKind) {
  for (const char* word : {"abc", "", "nan", "inf", "1e999", "--3"})
    EXPECT_THAT(number_problem(word, NumberKind::Any), HasSubstr("not a number")) << word;
  EXPECT_THAT(number_problem("7.5", NumberKind::Whole), HasSubstr("not a whole number"));
  EXPECT_THAT(number_problem("-1", NumberKind::Counting), HasSubstr("from 0 on"));
}

TEST(UsageError, RefusesWhatCWouldReadAsAnOctalNumber) {
  EXPECT_THAT(number_problem("010", NumberKind::Whole), HasSubstr("leave out the 0"));
  EXPECT_EQ(number_problem("010", NumberKind::Any), "");
  for (const char* word : {"0x10", "-0X1F", "0b11", "0o17"}) {
    EXPECT_THAT(number_problem(word, NumberKind::Any), HasSubstr("not a number: write it in decimal digits")) << word;
    EXPECT_THAT(number_problem(word, NumberKind::Counting), HasSubstr("decimal digits")) << word;
  }
}

TEST(UsageError, NamesTheNumberToWriteInsteadOfADecimalCommaOrAUnit) {
  EXPECT_THAT(number_problem("7,5", NumberKind::Any), HasSubstr("7.5"));
  EXPECT_THAT(number_problem("-7,25", NumberKind::Any), HasSubstr("-7.25"));
  EXPECT_THAT(number_problem("75mm", NumberKind::Any), HasSubstr("leave out \"mm\""));
}

TEST(UsageError, NamesTheChoiceThatWasMeant) {
  EXPECT_EQ(no_such_choice("sl2", Words{"goo", "sl1"}), "sl2 is none of goo, sl1; did you mean sl1?");
}

}  // namespace
}  // namespace telefab
