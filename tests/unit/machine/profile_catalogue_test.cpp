// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/machine/profile_digest.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::string_view kPrinter = R"(name = "printer"
[platform]
width_mm = 100.0
depth_mm = 50.0
z_travel_mm = 120.0
[projection]
pixel_pitch_mm = 0.05
irradiance_mw_per_cm2 = 4.0
[layers]
thickness_mm = 0.05
[resin]
critical_dose_mj_per_cm2 = 8.0
penetration_mm = 0.2
critical_dose_least_mj_per_cm2 = 7.0
critical_dose_most_mj_per_cm2 = 9.0
vat_ml = 300.0
green_strength_mpa = 15.0
)";

ProfilePart part(ProfileKind kind, std::string_view text, std::string_view file = "file.toml") {
  auto read = profile_part_from_toml(kind, text, file);
  EXPECT_TRUE(read) << read.error().what;
  return read ? std::move(*read) : ProfilePart{};
}
ProfilePart machine(std::string_view text = kPrinter) { return part(ProfileKind::Machine, text, "printer.toml"); }
ProfilePart resin(std::string_view text) { return part(ProfileKind::Resin, text, "resin.toml"); }
ProfilePart print(std::string_view text) { return part(ProfileKind::Print, text, "print.toml"); }

ComposedProfile composed(std::vector<ProfilePart> parts, const ProfileChoice& choice) {
  const auto catalogue = ProfileCatalogue::from(std::move(parts));
  EXPECT_TRUE(catalogue) << catalogue.error().what;
  if (!catalogue) return {};
  auto made = catalogue->compose(choice);
  EXPECT_TRUE(made) << made.error().what;
  return made ? std::move(*made) : ComposedProfile{};
}

std::string refusal(std::vector<ProfilePart> parts, const ProfileChoice& choice = {"printer"}) {
  const auto catalogue = ProfileCatalogue::from(std::move(parts));
  if (!catalogue) return catalogue.error().what;
  const auto made = catalogue->compose(choice);
  return made ? "" : made.error().what;
}

ComposedValue value(const ComposedProfile& profile, std::string_view key) {
  for (const ComposedValue& each : profile.values)
    if (each.key == key) return each;
  ADD_FAILURE() << "no key " << key;
  return {};
}

constexpr std::string_view kPriced =
    "name = \"grey\"\nprice_per_litre = 45\ncurrency = \"EUR\"\n"
    "[resin]\ncritical_dose_mj_per_cm2 = 8.0\npenetration_mm = 0.2\n";

TEST(ProfileCatalogue, TellsWhatTheResinCostsAndChangesNoDigestByIt) {
  const ComposedProfile priced = composed({machine(), resin(kPriced)}, {"printer", "grey"});
  ASSERT_TRUE(priced.price.has_value());
  EXPECT_EQ(*priced.price, (ResinPrice{45, "EUR"}));
  EXPECT_DOUBLE_EQ(priced.price->of_ml(200), 9);
  std::string free_text{kPriced};
  free_text.erase(free_text.find("price"), free_text.find("[resin]") - free_text.find("price"));
  const ComposedProfile free = composed({machine(), resin(free_text)}, {"printer", "grey"});
  EXPECT_FALSE(free.price.has_value());
  EXPECT_EQ(digest_of_profile(priced.profile), digest_of_profile(free.profile));
  // A file that inherits says its own, or has that of the other.
  const ProfilePart child = resin("name = \"white\"\ninherits = \"grey\"\n");
  EXPECT_EQ(composed({machine(), resin(kPriced), child}, {"printer", "white"}).price, priced.price);
  const ProfilePart dear = resin("name = \"white\"\ninherits = \"grey\"\nprice_per_litre = 99.5\ncurrency = \"USD\"\n");
  EXPECT_EQ(composed({machine(), resin(kPriced), dear}, {"printer", "white"}).price, (ResinPrice{99.5, "USD"}));
  EXPECT_FALSE(composed({machine(), resin(kPriced)}, {"printer"}).price.has_value())
      << "the machine's own resin is another one";
  EXPECT_EQ(resin(to_toml(dear)).price, dear.price);
}

TEST(ProfileCatalogue, RefusesAPriceWithoutCurrencyAndWhatIsNone) {
  const auto why = [](std::string_view stated, ProfileKind kind = ProfileKind::Resin) {
    const auto read = profile_part_from_toml(kind, "name = \"grey\"\n" + std::string{stated}, "grey.toml");
    return read ? std::string{} : read.error().what;
  };
  EXPECT_THAT(why("price_per_litre = 45"), HasSubstr("go together"));
  EXPECT_THAT(why("currency = \"EUR\""), HasSubstr("go together"));
  EXPECT_THAT(why("price_per_litre = 45\ncurrency = \"euro\""), AllOf(HasSubstr("line 3"), HasSubstr("three capital")));
  for (const char* price : {"0", "-1", "nan", "inf", "\"45\"", "2e6", "true"})
    EXPECT_THAT(why("currency = \"EUR\"\nprice_per_litre = " + std::string{price}), HasSubstr("number above 0"))
        << price;
  EXPECT_THAT(why("price_per_litre = 45\ncurrency = \"EUR\"", ProfileKind::Machine), HasSubstr("unknown key"));
}

TEST(ProfileCatalogue, ReadsAFileOfOneKindAsAWholeProfileWithTheSameDigest) {
  const std::string text =
      std::string{kPrinter}.replace(kPrinter.find("thickness_mm"), 0, "exposure_s = 3.5\nbottom_exposure_s = 20.0\n");
  const auto alone = machine_profile_from_toml(text, "printer.toml");
  ASSERT_TRUE(alone) << alone.error().what;
  const ComposedProfile made = composed({machine(text)}, {"printer"});
  EXPECT_EQ(made.profile, *alone);
  EXPECT_EQ(digest_of_profile(made.profile), digest_of_profile(*alone));
  EXPECT_EQ(digest_of_light(made.profile), digest_of_light(*alone));
}

TEST(ProfileCatalogue, ResinGoesBeforeTheMachineAndPrintBeforeBoth) {
  const ComposedProfile made = composed({machine(), resin("name = \"clear\"\n[resin]\npenetration_mm = 0.1\n"),
                                         print("name = \"fine\"\n[layers]\nthickness_mm = 0.025\n[motion]\n"
                                               "lift_mm = 8.0\n[supports]\ntip_radius_mm = 0.1\n")},
                                        {"printer", "clear", "fine"});
  EXPECT_EQ(made.profile.resin.penetration_mm, 0.1);
  EXPECT_EQ(made.profile.layers.thickness_mm, 0.025);
  EXPECT_EQ(made.profile.motion.lift_mm, 8);
  EXPECT_EQ(made.profile.supports.tip_radius_mm, 0.1);
  EXPECT_EQ(made.profile.platform.width_mm, 100);
}

// A calibration of one resin says nothing of another; the vat stays the same vat.
TEST(ProfileCatalogue, AnotherResinTakesAllOfTheOldOneWithItButTheVat) {
  const ComposedProfile made =
      composed({machine(), resin("name = \"clear\"\n[resin]\npenetration_mm = 0.1\n")}, {"printer", "clear"});
  const MachineProfile::Resin untouched;
  EXPECT_EQ(made.profile.resin.critical_dose_mj_per_cm2, untouched.critical_dose_mj_per_cm2);
  EXPECT_FALSE(made.profile.states_calibration_band());
  EXPECT_EQ(made.profile.resin.critical_dose_least_mj_per_cm2, 0);
  EXPECT_EQ(made.profile.resin.green_strength_mpa, 0);
  EXPECT_EQ(made.profile.resin.vat_ml, 300);
  EXPECT_EQ(made.profile.resin.name, "clear");
}

TEST(ProfileCatalogue, SaysOfEveryValueWhichFileStatesItAndWhatIsAssumed) {
  const ComposedProfile made =
      composed({machine(),
                resin("name = \"base\"\nis_base = true\nassumed = [\"resin.critical_dose_mj_per_cm2\"]\n[resin]\n"
                      "critical_dose_mj_per_cm2 = 5.0\npenetration_mm = 0.15\n"),
                part(ProfileKind::Resin, "name = \"clear\"\ninherits = \"base\"\n[resin]\npenetration_mm = 0.1\n",
                     "clear.toml")},
               {"printer", "clear"});
  EXPECT_EQ(value(made, "platform.width_mm").origin, ValueOrigin::Stated);
  EXPECT_EQ(value(made, "platform.width_mm").file, "printer.toml");
  EXPECT_EQ(value(made, "resin.penetration_mm").origin, ValueOrigin::Stated);
  EXPECT_EQ(value(made, "resin.penetration_mm").file, "clear.toml");
  EXPECT_EQ(value(made, "resin.critical_dose_mj_per_cm2").origin, ValueOrigin::Inherited);
  EXPECT_EQ(value(made, "resin.critical_dose_mj_per_cm2").file, "resin.toml");
  EXPECT_TRUE(value(made, "resin.critical_dose_mj_per_cm2").is_assumed);
  EXPECT_EQ(value(made, "motion.lift_mm").origin, ValueOrigin::Default);
  EXPECT_EQ(value(made, "layers.exposure_s").origin, ValueOrigin::Derived);
  EXPECT_TRUE(value(made, "layers.exposure_s").is_assumed) << "derived from an Ec that is assumed";
  EXPECT_THAT(made.profile.assumed, ElementsAre("resin.critical_dose_mj_per_cm2"));
}

TEST(ProfileCatalogue, WhatAChildStatesItselfIsNoLongerAssumed) {
  const ComposedProfile made =
      composed({machine(),
                resin("name = \"base\"\nassumed = [\"resin.green_strength_mpa\"]\n[resin]\ngreen_strength_mpa = 9.0\n"),
                resin("name = \"measured\"\ninherits = \"base\"\n[resin]\ngreen_strength_mpa = 21.0\n")},
               {"printer", "measured"});
  EXPECT_TRUE(made.profile.assumed.empty());
  EXPECT_EQ(made.profile.resin.green_strength_mpa, 21);
}

TEST(ProfileCatalogue, HoldsNoPrintByAStrengthThatIsAssumed) {
  const std::string pulled = std::string{kPrinter} + "[motion]\npull_kpa = 20.0\n";
  const std::string strong = "name = \"clear\"\n[resin]\ngreen_strength_mpa = 38.0\n";
  EXPECT_TRUE(composed({machine(pulled), resin(strong)}, {"printer", "clear"}).profile.states_what_carries());
  EXPECT_FALSE(
      composed({machine(pulled), resin("assumed = [\"resin.green_strength_mpa\"]\n" + strong)}, {"printer", "clear"})
          .profile.states_what_carries());
}

TEST(ProfileCatalogue, DerivesAnExposureThatCuresTwoLayersDeep) {
  const ComposedProfile made = composed({machine()}, {"printer"});
  const auto& p = made.profile;
  EXPECT_NEAR(p.layers.exposure_s, 8.0 * std::exp(2 * 0.05 / 0.2) / 4.0, 0.0005);
  const double depth_mm = p.resin.penetration_mm * std::log(p.layers.exposure_s * p.projection.irradiance_mw_per_cm2 /
                                                            p.resin.critical_dose_mj_per_cm2);
  EXPECT_NEAR(depth_mm, 2 * p.layers.thickness_mm, 1e-4);
  EXPECT_NEAR(p.layers.bottom_exposure_s, p.layers.bottom_factor * p.layers.exposure_s, 0.0005);
  EXPECT_EQ(p.layers.exposure_s * 1000, std::round(p.layers.exposure_s * 1000)) << "to a millisecond";
  EXPECT_FALSE(value(made, "layers.exposure_s").is_assumed);
}

TEST(ProfileCatalogue, TakesTheMachinesExposureForItsOwnResinAndThicknessAlone) {
  const std::string exposed =
      std::string{kPrinter}.replace(kPrinter.find("thickness_mm"), 0, "exposure_s = 3.5\nbottom_exposure_s = 20.0\n");
  const std::vector<ProfilePart> parts{machine(exposed), resin("name = \"clear\"\n"),
                                       print("name = \"same\"\n[layers]\nthickness_mm = 0.05\n"),
                                       print("name = \"fine\"\n[layers]\nthickness_mm = 0.025\n")};
  EXPECT_EQ(composed(parts, {"printer"}).profile.layers.exposure_s, 3.5);
  EXPECT_EQ(composed(parts, {"printer", "", "same"}).profile.layers.bottom_exposure_s, 20);
  for (const ProfileChoice& other : {ProfileChoice{"printer", "clear"}, {"printer", "", "fine"}}) {
    const ComposedProfile made = composed(parts, other);
    EXPECT_EQ(value(made, "layers.exposure_s").origin, ValueOrigin::Derived) << other.resin << other.print;
    EXPECT_EQ(value(made, "layers.bottom_exposure_s").origin, ValueOrigin::Derived) << other.resin << other.print;
  }
}

TEST(ProfileCatalogue, TakesWhatIsPublishedForThisMachineOrOneThatItInheritsFromAndThisThickness) {
  const std::vector<ProfilePart> parts{
      machine(), machine("name = \"second\"\ninherits = \"printer\"\n"),
      machine("name = \"third\"\ninherits = \"printer\"\n[layers]\nthickness_mm = 0.1\n"),
      resin("name = \"clear\"\n[[exposures]]\nmachine = \"printer\"\nthickness_mm = 0.05\nexposure_s = 2.5\n"
            "[[exposures]]\nmachine = \"second\"\nthickness_mm = 0.05\nexposure_s = 2.25\nbottom_exposure_s = 33.0\n"),
      print("name = \"slow\"\n[layers]\nexposure_s = 9.0\n")};
  EXPECT_EQ(composed(parts, {"printer", "clear"}).profile.layers.exposure_s, 2.5);
  EXPECT_EQ(composed(parts, {"printer", "clear"}).profile.layers.bottom_exposure_s, 20) << "8 times; none is published";
  EXPECT_EQ(composed(parts, {"second", "clear"}).profile.layers.exposure_s, 2.25);
  EXPECT_EQ(composed(parts, {"second", "clear"}).profile.layers.bottom_exposure_s, 33);
  EXPECT_EQ(value(composed(parts, {"second", "clear"}), "layers.exposure_s").file, "resin.toml");
  EXPECT_EQ(value(composed(parts, {"third", "clear"}), "layers.exposure_s").origin, ValueOrigin::Derived);
  EXPECT_EQ(composed(parts, {"printer", "clear", "slow"}).profile.layers.exposure_s, 9) << "a print states it";
}

TEST(ProfileCatalogue, TakesAPrintsExposureForTheMachineAndResinThatItIsForAlone) {
  const std::vector<ProfilePart> parts{machine(),
                                       machine("name = \"second\"\ninherits = \"printer\"\n"),
                                       machine(std::string{kPrinter}.replace(8, 7, "another")),
                                       resin("name = \"clear\"\n"),
                                       resin("name = \"tinted\"\ninherits = \"clear\"\n"),
                                       resin("name = \"other\"\n"),
                                       print("name = \"tuned\"\nfor_machine = \"printer\"\nfor_resin = \"clear\"\n"
                                             "[layers]\nexposure_s = 1.75\nbottom_exposure_s = 21.0\n")};
  EXPECT_EQ(composed(parts, {"printer", "clear", "tuned"}).profile.layers.exposure_s, 1.75);
  EXPECT_EQ(composed(parts, {"second", "tinted", "tuned"}).profile.layers.bottom_exposure_s, 21);
  for (const ProfileChoice& other :
       {ProfileChoice{"printer", "other", "tuned"}, {"another", "clear", "tuned"}, {"printer", "", "tuned"}})
    EXPECT_EQ(value(composed(parts, other), "layers.exposure_s").origin, ValueOrigin::Derived) << other.machine;
}

TEST(ProfileCatalogue, RefusesAnExposureThatCannotBeDerivedWithinItsRange) {
  const std::string what =
      refusal({machine(), resin("name = \"slow\"\n[resin]\ncritical_dose_mj_per_cm2 = 9000.0\n")}, {"printer", "slow"});
  EXPECT_THAT(what, AllOf(HasSubstr("layers.exposure_s"), HasSubstr("slow"), HasSubstr("0.001 to 300")));
}

TEST(ProfileCatalogue, RefusesUnknownParentsAndRingsWithFileAndLine) {
  EXPECT_THAT(refusal({machine(), resin("name = \"clear\"\ninherits = \"cleer\"\n")}),
              AllOf(HasSubstr("resin profile resin.toml, line 2"), HasSubstr("\"cleer\""), HasSubstr("no resin")));
  EXPECT_THAT(refusal({machine(), resin("name = \"printer-like\"\ninherits = \"printer\"\n")}), HasSubstr("no resin"))
      << "only a resin can be the parent of one";
  EXPECT_THAT(refusal({machine(), print("name = \"a\"\ninherits = \"b\"\n"),
                       part(ProfileKind::Print, "name = \"b\"\n\ninherits = \"c\"\n", "b.toml"),
                       print("name = \"c\"\ninherits = \"b\"\n")}),
              AllOf(HasSubstr("print profile print.toml, line 2"), HasSubstr("ring"), HasSubstr("b <- c <- b")));
  EXPECT_THAT(refusal({machine(), resin("name = \"self\"\ninherits = \"self\"\n")}), HasSubstr("self <- self"));
}

TEST(ProfileCatalogue, RefusesTwoOfOneNameAndAMachineThatIsNotWhole) {
  EXPECT_THAT(refusal({machine(), machine()}), HasSubstr("a second machine is named printer"));
  EXPECT_THAT(refusal({machine(), part(ProfileKind::Machine, "name = \"bare\"\n", "bare.toml")}),
              AllOf(HasSubstr("machine profile bare.toml"), HasSubstr("platform.width_mm is missing")));
  EXPECT_EQ(refusal({machine(), machine("name = \"bare\"\nis_base = true\n")}), "") << "a base need not be whole";
}

TEST(ProfileCatalogue, RefusesNamesThatItDoesNotKnowAndListsThoseThereAre) {
  const std::vector<ProfilePart> parts{machine(), resin("name = \"clear\"\n"),
                                       resin("name = \"base\"\nis_base = true\n"), print("name = \"fine\"\n")};
  EXPECT_THAT(refusal(parts, {"primter"}), AllOf(HasSubstr("primter"), HasSubstr("there are: printer")));
  EXPECT_THAT(refusal(parts, {"printer", "cleer"}), AllOf(HasSubstr("no resin named cleer"), HasSubstr("clear")));
  EXPECT_THAT(refusal(parts, {"printer", "base"}), HasSubstr("no resin named base")) << "bases are not offered";
  EXPECT_THAT(refusal(parts, {"printer", "", "fast"}), AllOf(HasSubstr("no print named fast"), HasSubstr("fine")));
}

TEST(ProfileCatalogue, PrintsWithTheResinThatIsLoadedAndRefusesAnother) {
  const std::string loaded = "loaded_resin = \"clear\"\n" + std::string{kPrinter};
  const std::vector<ProfilePart> parts{machine(loaded), resin("name = \"clear\"\n[resin]\npenetration_mm = 0.125\n"),
                                       resin("name = \"other\"\n")};
  EXPECT_EQ(composed(parts, {"printer"}).profile.resin.penetration_mm, 0.125);
  EXPECT_EQ(composed(parts, {"printer"}).resin, "clear");
  EXPECT_EQ(composed(parts, {"printer", "clear"}).profile, composed(parts, {"printer"}).profile);
  EXPECT_THAT(refusal(parts, {"printer", "other"}),
              AllOf(HasSubstr("printer has the resin clear loaded, not other"), HasSubstr("printer.toml")));
  const ComposedProfile exposed =
      composed({machine(std::string{loaded}.replace(loaded.find("thickness_mm"), 0, "exposure_s = 3.5\n")), parts[1]},
               {"printer"});
  EXPECT_EQ(value(exposed, "layers.exposure_s").origin, ValueOrigin::Derived) << "3.5 s were for the resin before";
  EXPECT_THAT(refusal({machine(loaded)}), AllOf(HasSubstr("printer.toml, line 1"), HasSubstr("no resin named clear")));
}

TEST(ProfileCatalogue, RefusesWhatThePrinterCannotDo) {
  const auto with = [](std::string_view section, std::string_view line) {
    return machine(std::string{kPrinter}.replace(kPrinter.find(section) + section.size(), 0, line));
  };
  const ProfilePart thin =
      print("name = \"thin\"\n[layers]\nthickness_mm = 0.01\n[motion]\nlower_speed_mm_per_s = 9.0\n");
  EXPECT_THAT(
      refusal({with("[platform]\n", "least_layer_mm = 0.02\nmost_layer_mm = 0.1\n"), thin}, {"printer", "", "thin"}),
      AllOf(HasSubstr("print.toml"), HasSubstr("0.01 is beyond what printer prints, 0.02 to 0.1")));
  EXPECT_THAT(refusal({machine(std::string{kPrinter} + "[motion]\nmost_speed_mm_per_s = 5.0\n"), thin},
                      {"printer", "", "thin"}),
              AllOf(HasSubstr("motion.lower_speed_mm_per_s 9"), HasSubstr("printer moves at, 5")));
  EXPECT_THAT(refusal({with("[projection]\n", "width_px = 2001\nheight_px = 1000\n")}),
              HasSubstr("states 2001 x 1000 pixels, but platform and pitch give 2000 x 1000"));
}

TEST(ProfilePart, ComesBackFromItsOwnTextAndComposesToTheSame) {
  const auto all = builtin_profiles();
  ASSERT_TRUE(all) << all.error().what;
  const auto again = ProfileCatalogue::from_texts(all->texts(ProfileKind::Machine), all->texts(ProfileKind::Resin),
                                                  all->texts(ProfileKind::Print), "sent");
  ASSERT_TRUE(again) << again.error().what;
  ASSERT_GT(all->machines().size(), 20U);
  EXPECT_EQ(again->machines(), all->machines());
  for (const ProfilePart* resin : all->offered(ProfileKind::Resin))
    for (const ProfilePart* print : all->offered(ProfileKind::Print)) {
      const ProfileChoice choice{"uniformation-gktwo", resin->name, print->name};
      EXPECT_EQ(digest_of_profile(again->compose(choice)->profile), digest_of_profile(all->compose(choice)->profile))
          << resin->name << ' ' << print->name;
    }
}

// A handshake on a bad line must be short, and a fab offers the whole catalogue.
TEST(ProfilePart, OfABuiltInFileOnlyTheNameIsSent) {
  const auto all = builtin_profiles();
  ASSERT_TRUE(all) << all.error().what;
  std::size_t bytes = 0;
  for (const ProfileKind kind : kProfileKinds)
    for (const std::string& text : all->texts(kind)) bytes += text.size();
  EXPECT_LT(bytes, 4000U);
  auto changed = builtin_profile_parts(ProfileKind::Resin).value();
  changed.front().values.resin.penetration_mm = 0.5;
  changed.front().lines["resin.penetration_mm"] = 1;
  changed.push_back(machine());
  const auto own = ProfileCatalogue::from(changed);
  ASSERT_TRUE(own) << own.error().what;
  EXPECT_THAT(own->texts(ProfileKind::Resin).front(), HasSubstr("penetration_mm = 0.5"));
  const auto texts = own->texts(ProfileKind::Machine);
  const std::vector<std::string> unknown{"name = \"of-another-release\"\nbuilt_in = true\n"};
  const auto received = ProfileCatalogue::from_texts(texts, unknown, {}, "sent");
  ASSERT_TRUE(received) << received.error().what;
  EXPECT_TRUE(received->offered(ProfileKind::Resin).empty());
  EXPECT_THAT(refusal({machine("name = \"dlp6500\"\nbuilt_in = true\n")}), HasSubstr("built_in"));
}

TEST(ProfilePart, RefusesWhatIsNotItsKindsToStateWithItsLine) {
  const auto why = [](ProfileKind kind, std::string_view text) {
    const auto read = profile_part_from_toml(kind, text, "x.toml");
    return read ? std::string{} : read.error().what;
  };
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\n[layers]\nexposure_s = 3.0\n"),
              AllOf(HasSubstr("resin profile x.toml, line 2"), HasSubstr("[layers]")));
  EXPECT_THAT(why(ProfileKind::Print, "name = \"x\"\n[resin]\npenetration_mm = 0.1\n"), HasSubstr("[resin]"));
  EXPECT_THAT(why(ProfileKind::Print, "name = \"x\"\nloaded_resin = \"y\"\n"),
              HasSubstr("unknown key \"loaded_resin\""));
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\n[resin]\npenetration = 0.1\n"),
              AllOf(HasSubstr("line 3"), HasSubstr("resin.penetration")));
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\n[resin]\npenetration_mm = 99.0\n"), HasSubstr("0.001 to 10"));
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\nassumed = [\"resin.penetration\"]\n"), HasSubstr("not a key"));
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\nassumed = [\"resin.penetration_mm\"]\n"),
              HasSubstr("does not state"));
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\n[[exposures]]\nmachine = \"y\"\nexposure_s = 2.0\n"),
              HasSubstr("needs machine, thickness_mm and exposure_s"));
  EXPECT_THAT(why(ProfileKind::Resin, "name = \"x\"\n[[exposures]]\nmachine = \"y\"\nexposure_s = 9000.0\n"),
              HasSubstr("0.001 to 300"));
  EXPECT_THAT(why(ProfileKind::Machine, "name = \"X\"\n"), HasSubstr("a-z, 0-9 and -"));
  EXPECT_THAT(why(ProfileKind::Machine, "name = \"x\"\ninherits = 3\n"),
              AllOf(HasSubstr("line 2"), HasSubstr("inherits")));
  EXPECT_THAT(why(ProfileKind::Print, "name ="), HasSubstr("print profile x.toml, line 1"));
}

class ProfileFolderTest : public testing::Test {
 protected:
  void keep(const std::string& file, std::string_view text) const {
    fs::create_directories((root / file).parent_path());
    std::ofstream{root / file} << text;
  }
  test::ScratchFolder scratch;
  fs::path root = scratch.path();
};

TEST_F(ProfileFolderTest, AFileMayInheritFromABuiltInOneThatIsNotOfferedWithIt) {
  keep("machines/own.toml",
       "name = \"own\"\ninherits = \"elegoo-mars-3\"\n[projection]\nirradiance_mw_per_cm2 = 3.75\n");
  const auto known = load_profiles(root / "machines");
  ASSERT_TRUE(known) << known.error().what;
  ASSERT_EQ(known->machines().size(), 1U);
  EXPECT_EQ(known->machines()[0].mask_size(), (PixelSize{4098, 2560}));
  EXPECT_FALSE(known->machines()[0].is_assumed("projection.irradiance_mw_per_cm2"));
  EXPECT_FALSE(known->compose({"elegoo-mars-3"}));
  EXPECT_THAT(value(*known->compose({"own"}), "platform.width_mm").file, HasSubstr("built-in elegoo-mars-3.toml"));
}

TEST_F(ProfileFolderTest, ResinsAndPrintsBesideTheMachinesGoBeforeBuiltInOnes) {
  keep("machines/printer.toml", kPrinter);
  keep("resins/clear.toml", "name = \"formlabs-clear\"\n[resin]\npenetration_mm = 0.175\n");
  keep("prints/own.toml", "name = \"own\"\n[layers]\nthickness_mm = 0.04\n");
  for (const fs::path& folder : {root / "machines", root / "machines/", root / "machines/../machines/."}) {
    const auto known = load_profiles(folder);
    ASSERT_TRUE(known) << known.error().what;
    EXPECT_EQ(known->resin("formlabs-clear")->profile.resin.penetration_mm, 0.175) << folder;
    EXPECT_EQ(known->compose({"printer", "", "own"})->profile.layers.thickness_mm, 0.04) << folder;
    EXPECT_TRUE(known->compose({"printer", "formlabs-durable", "fine"})) << folder;
  }
}

TEST_F(ProfileFolderTest, FailsByNameWhereAFileIsBadAndWhereThereIsNoMachine) {
  EXPECT_EQ(load_profiles(root / "machines").error().code, ErrorCode::NotFound);
  fs::create_directories(root / "machines");
  EXPECT_EQ(load_profiles(root / "machines").error().code, ErrorCode::NotFound);
  keep("machines/printer.toml", kPrinter);
  keep("resins/bad.toml", "name = 3\n");
  EXPECT_THAT(load_profiles(root / "machines").error().what, HasSubstr("resins/bad.toml, line 1"));
}

}  // namespace
}  // namespace telefab
