// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/base/nearest_name.hpp>
#include <vector>

namespace telefab {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using Words = std::vector<std::string>;

const Words kVerbs{"slice", "inspect", "register", "serve", "cancel", "machines"};
const Words kOptions{"--height-mm", "--layer-mm", "--machine", "--machines", "--fit", "--up"};

TEST(NearestName, FindsTheNameBehindASlipOfTheKeys) {
  EXPECT_EQ(nearest_name("slise", kVerbs), "slice");
  EXPECT_EQ(nearest_name("cancle", kVerbs), "cancel");
  EXPECT_EQ(nearest_name("inpsect", kVerbs), "inspect");
  EXPECT_EQ(nearest_name("--machnie", kOptions), "--machine");
  EXPECT_EQ(nearest_name("--ifit", kOptions), "--fit");
}

TEST(NearestName, FindsTheNameThatLacksItsEnd) {
  EXPECT_EQ(nearest_name("--height", kOptions), "--height-mm");
  EXPECT_EQ(nearest_name("reg", kVerbs), "register");
}

TEST(NearestName, FindsTheNameWhoseWordsStandInAnotherOrder) {
  EXPECT_EQ(nearest_name("--mm-height", kOptions), "--height-mm");
  EXPECT_EQ(nearest_name("mars-elegoo-3", Words{"elegoo-mars-2", "elegoo-mars-3"}), "elegoo-mars-3");
}

TEST(NearestName, FindsTheNameThatWasSaidWithMoreWords) {
  EXPECT_EQ(nearest_name("--machine-name", kOptions), "--machine");
  EXPECT_EQ(nearest_name("close-base", Words{"stand", "base"}), "base");
}

TEST(NearestName, GuessesNothingFarFromAnyName) {
  for (const char* word : {"dragon", "x", "-", "--", "", "--quality"}) {
    EXPECT_EQ(nearest_name(word, kVerbs), std::nullopt) << word;
    EXPECT_EQ(nearest_name(word, kOptions), std::nullopt) << word;
  }
}

TEST(NamesInstead, NamesWhatWasMeantAndAShortListWhole) {
  EXPECT_EQ(names_instead("slise", kVerbs, "`verbs`"),
            "did you mean slice? there are: slice, inspect, register, serve, cancel, machines");
  EXPECT_EQ(names_instead("x", {}, "`verbs`"), "there is none");
}

TEST(NamesInstead, SendsWhoeverWantsALongListToTheVerbThatListsIt) {
  Words many;
  for (int i = 10; i < 60; ++i) many.push_back("machine-" + std::to_string(i));
  EXPECT_EQ(names_instead("machine-1", many, "`machines`"),
            "did you mean machine-10? `machines` lists the 50 there are");
  EXPECT_THAT(names_instead("dragon", many, "`machines`"),
              AllOf(HasSubstr("the 50 there are: machine-10, machine-11"), Not(HasSubstr("machine-59"))));
}

}  // namespace
}  // namespace telefab
