// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/machine/machine_instances.hpp>
#include <telefab/machine/profile_digest.hpp>

namespace telefab {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::string_view kBoth = R"([[machine]]
name = "hall-1"
profile = "machine-a"
resin = "formlabs-clear"
print = "fine"
description = "By the window"
[machine.devices]
projector = "dlpc900"
projector_serial = "T1"

[[machine]]
name = "hall-2"
profile = "machine-a"
)";

std::vector<MachineInstance> list(std::string_view text) {
  auto read = machine_instances_from_toml(text, "fab.toml");
  EXPECT_TRUE(read) << read.error().what;
  return read ? std::move(*read) : std::vector<MachineInstance>{};
}
std::string refusal(std::string_view text) {
  const auto read = machine_instances_from_toml(text, "fab.toml");
  return read ? "" : read.error().what;
}
const ProfileCatalogue& known() {
  static const ProfileCatalogue profiles = *builtin_profiles();
  return profiles;
}
std::string refusal_of(std::string_view text) {
  const auto made = with_instances(known(), list(text));
  return made ? "" : made.error().what;
}
std::vector<std::string> offered(const ProfileCatalogue& catalogue) {
  std::vector<std::string> names;
  for (const ProfilePart* part : catalogue.offered(ProfileKind::Machine)) names.push_back(part->name);
  return names;
}

TEST(MachineInstances, AreReadWithWhatTheyStateThemselves) {
  const auto instances = list(kBoth);
  ASSERT_EQ(instances.size(), 2U);
  EXPECT_EQ(instances[0].name, "hall-1");
  EXPECT_EQ(instances[0].profile, "machine-a");
  EXPECT_TRUE(instances[0].is_stated);
  EXPECT_TRUE(instances[0].part.states("devices.projector_serial"));
  EXPECT_FALSE(instances[1].part.states("devices.projector_serial"));
}

TEST(MachineInstances, StateTheScreenAndTheLightThatAreTheirOwn) {
  const auto instances = list(
      "[[machine]]\nname = \"left\"\nprofile = \"machine-a\"\n[machine.screen]\nconnector = \"HDMI-A-1\"\n"
      "[machine.light]\nnumber = 2\n");
  ASSERT_EQ(instances.size(), 1U);
  EXPECT_TRUE(instances[0].part.states("screen.connector"));
  EXPECT_TRUE(instances[0].part.states("light.number"));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\"\nprofile = \"b\"\n[machine.screen]\nusb = \"c\""),
              HasSubstr("unknown key \"machine.screen.usb\""));
}

TEST(MachineInstances, AreRefusedByFileAndLineWithWhatToDo) {
  EXPECT_THAT(refusal(""), HasSubstr("fab.toml has no [[machine]]"));
  EXPECT_THAT(refusal("name = \"a\""), HasSubstr("line 1: \"name\" is not a [[machine]] table"));
  EXPECT_THAT(refusal("[machine]\nname = \"a\""), HasSubstr("not a [[machine]] table"));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\""), HasSubstr("needs profile"));
  EXPECT_THAT(refusal("[[machine]]\nprofile = \"a\""), HasSubstr("needs name"));
  EXPECT_THAT(refusal("[[machine]]\nname = \"Hall 1\"\nprofile = \"a\""),
              HasSubstr("line 2: name must be 1 to 64 of a-z, 0-9 and -"));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\"\nprofile = \"b\"\nresins = \"c\""),
              HasSubstr("line 4: unknown key \"resins\""));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\"\nprofile = \"b\"\n[machine.devices]\nusb = \"c\""),
              HasSubstr("line 5: unknown key \"machine.devices.usb\""));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\"\nprofile = \"b\"\n[machine.layers]\nthickness_mm = 1.0"),
              HasSubstr("unknown key \"layers\""));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\"\nprofile = \"b\"\n[machine.devices]\nled_current = 256"),
              HasSubstr("led_current"));
  EXPECT_THAT(refusal("[[machine]]\nname = \"a\"\nprofile = \"b\"\n[[machine]]\nname = \"a\"\nprofile = \"c\""),
              HasSubstr("a second machine is named a"));
  EXPECT_THAT(refusal("[[machine]\n"), HasSubstr("fab.toml, line 1"));
  std::string many;
  for (std::size_t i = 0; i <= kMaxInstances; ++i)
    many += "[[machine]]\nname = \"m" + std::to_string(i) + "\"\nprofile = \"a\"\n";
  EXPECT_THAT(refusal(many), HasSubstr("has 65 machines; a fab may have 64"));
}

TEST(MachineInstances, AreOfferedByNameBesideTheirProfilesAndNothingElseIs) {
  const auto catalogue = with_instances(known(), list(kBoth));
  ASSERT_TRUE(catalogue) << catalogue.error().what;
  EXPECT_THAT(offered(*catalogue), ElementsAre("machine-a", "hall-1", "hall-2"));
  EXPECT_FALSE(catalogue->compose({"machine-b"})) << "none stands there";
}

TEST(MachineInstances, PrintWithTheirOwnResinWayToPrintAndDevices) {
  const auto catalogue = with_instances(known(), list(kBoth));
  ASSERT_TRUE(catalogue) << catalogue.error().what;
  const auto own = catalogue->compose({"hall-1"});
  ASSERT_TRUE(own) << own.error().what;
  EXPECT_EQ(own->resin, "formlabs-clear");
  EXPECT_EQ(own->print, "fine");
  EXPECT_EQ(own->profile.name, "machine-a") << "what is planned for it may be printed on any of them";
  EXPECT_EQ(digest_of_light(catalogue->compose({"hall-2"})->profile),
            digest_of_light(catalogue->compose({"machine-a"})->profile));
  EXPECT_EQ(own->profile.devices.projector, ProjectorKind::Dlpc900);
  EXPECT_EQ(catalogue->compose({"hall-1", "", "fast"})->print, "fast") << "a job may choose another way";
  EXPECT_FALSE(catalogue->compose({"hall-1", "formlabs-elastic-50a"})) << "and no other resin than what is loaded";
  EXPECT_EQ(catalogue->compose({"hall-2"})->profile.devices.projector, ProjectorKind::Virtual);
}

TEST(MachineInstances, AreTheSameAtTheOtherSite) {
  const auto here = with_instances(known(), list(kBoth));
  ASSERT_TRUE(here) << here.error().what;
  const auto there = ProfileCatalogue::from_texts(here->texts(ProfileKind::Machine), here->texts(ProfileKind::Resin),
                                                  here->texts(ProfileKind::Print), "the fab");
  ASSERT_TRUE(there) << there.error().what;
  EXPECT_EQ(offered(*there), offered(*here));
  for (const std::string& name : offered(*here))
    EXPECT_EQ(digest_of_profile(there->compose({name})->profile), digest_of_profile(here->compose({name})->profile));
}

TEST(MachineInstances, OfAnUnknownProfileResinOrWayToPrintAreRefused) {
  EXPECT_THAT(refusal_of("[[machine]]\nname = \"a\"\nprofile = \"machine-x\""),
              HasSubstr("line 3: machine a is of the profile machine-x, which is not known; there are: "));
  EXPECT_THAT(refusal_of("[[machine]]\nname = \"a\"\nprofile = \"machine-a\"\nresin = \"tar\""),
              HasSubstr("line 4: no resin named tar"));
  EXPECT_THAT(refusal_of("[[machine]]\nname = \"a\"\nprofile = \"machine-a\"\nprint = \"wild\""),
              HasSubstr("line 4: no print named wild"));
}

TEST(MachineInstances, MayBeNamedAsTheirProfileWhereThatMeansOneThing) {
  EXPECT_EQ(refusal_of("[[machine]]\nname = \"machine-a\"\nprofile = \"machine-a\""), "");
  EXPECT_THAT(refusal_of("[[machine]]\nname = \"machine-b\"\nprofile = \"machine-a\""),
              HasSubstr("its name is that of another profile"));
  EXPECT_THAT(refusal_of("[[machine]]\nname = \"machine-a\"\nprofile = \"machine-a\"\n"
                         "[[machine]]\nname = \"b\"\nprofile = \"machine-a\""),
              HasSubstr("not the only one of its profile"));
  EXPECT_THAT(refusal_of("[[machine]]\nname = \"machine-a\"\nprofile = \"machine-a\"\nresin = \"formlabs-clear\""),
              HasSubstr("is named as its profile, which states resin, print and devices"));
}

TEST(MachineInstances, OneOfEachOffersWhatWasOfferedBefore) {
  const auto catalogue = with_instances(known(), one_of_each(known()));
  ASSERT_TRUE(catalogue) << catalogue.error().what;
  EXPECT_EQ(offered(*catalogue), offered(known()));
  EXPECT_EQ(catalogue->machines(), known().machines());
}

TEST(MachineInstances, FitAJobForTheirProfileWithTheResinTheyHaveAndTheLightItStates) {
  std::string text{kBoth};
  text.append("[[machine]]\nname = \"bright\"\nprofile = \"machine-a\"\n[machine.devices]\nled_current = 40\n");
  const auto instances = list(text);
  const auto catalogue = with_instances(known(), instances);
  ASSERT_TRUE(catalogue) << catalogue.error().what;
  const auto fit = [&](std::size_t place, const ProfileChoice& choice) {
    const auto found = fit_of(*catalogue, instances[place], choice);
    EXPECT_TRUE(found) << found.error().what;
    return found.value_or(InstanceFit::OtherMachine);
  };
  EXPECT_EQ(fit(0, {"machine-a"}), InstanceFit::OtherResin) << "the profile states its own";
  EXPECT_EQ(fit(0, {"machine-a", "formlabs-clear"}), InstanceFit::Fits);
  EXPECT_EQ(fit(0, {"machine-a", "formlabs-clear", "fast"}), InstanceFit::Fits);
  EXPECT_EQ(fit(0, {"machine-a", "formlabs-elastic-50a"}), InstanceFit::OtherResin);
  EXPECT_EQ(fit(0, {"hall-1"}), InstanceFit::Fits);
  EXPECT_EQ(fit(0, {"hall-2"}), InstanceFit::OtherMachine);
  EXPECT_EQ(fit(1, {"machine-a"}), InstanceFit::Fits);
  EXPECT_EQ(fit(1, {"machine-a", "formlabs-clear"}), InstanceFit::Fits) << "nothing is stated to be loaded";
  EXPECT_EQ(fit(2, {"machine-a"}), InstanceFit::OtherLight);
  EXPECT_EQ(fit(2, {"bright"}), InstanceFit::Fits);
}

}  // namespace
}  // namespace telefab
