// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/test/two_sites.hpp>

// Resins and ways to print, chosen at submit and carried to the printer.

namespace telefab::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class ChosenProfiles : public TwoSites {
 protected:
  ChosenProfiles() {
    keep("resins/clear.toml",
         "name = \"clear\"\ndescription = \"Clear\"\n[resin]\ncritical_dose_mj_per_cm2 = 6.0\n"
         "penetration_mm = 0.25\n");
    keep("resins/tinted.toml", "name = \"tinted\"\ninherits = \"clear\"\n");
    keep("prints/thin.toml", "name = \"thin\"\n[layers]\nthickness_mm = 0.1\n");
  }
  void keep(const std::string& file, const std::string& text) const {
    std::filesystem::create_directories((folder() / file).parent_path());
    std::ofstream{folder() / file} << text;
  }
  /// The machine with `resin` in its vat.
  void load(const std::string& resin) const {
    set_machine(5000);
    const auto toml = folder() / "machines" / "toy.toml";
    const std::string text = text_of(toml);
    std::ofstream{toml} << "loaded_resin = \"" << resin << "\"\n" << text;
  }
  [[nodiscard]] Outcome submit(std::vector<std::string> more) const {
    std::vector<std::string> words{"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--json"};
    words.insert(words.end(), more.begin(), more.end());
    return telefab(words);
  }
};

TEST_F(ChosenProfiles, AreWhatTheJobIsSlicedPlannedAndPrintedWith) {
  start_both();
  const Outcome done = submit({"--resin", "clear", "--print", "thin", "--watch"});
  ASSERT_EQ(done.code, 0) << done.errors;
  const json job = json::parse(done.output);
  EXPECT_EQ(job["state"], "done");
  EXPECT_EQ(job["parameters"]["resin"], "clear");
  EXPECT_EQ(job["parameters"]["print"], "thin");
  EXPECT_EQ(job["layers"], 40) << "4 mm in layers of 0.1 mm";
  const auto known = load_profiles(folder() / "machines");
  ASSERT_TRUE(known) << known.error().what;
  const auto composed = known->compose({"toy", "clear", "thin"});
  ASSERT_TRUE(composed) << composed.error().what;
  const MachineProfile& p = composed->profile;
  EXPECT_NEAR(p.layers.exposure_s, 6.0 * std::exp(2 * 0.1 / 0.25) / p.projection.irradiance_mw_per_cm2, 0.0005);
  const json record =
      json::parse(text_of(folder() / "fab" / "jobs" / job["id"].get<std::string>() / "report" / "print.json"));
  EXPECT_THAT(record.dump(), HasSubstr("toy"));
  const json plan =
      json::parse(text_of(folder() / "fab" / "jobs" / job["id"].get<std::string>() / "plan" / "plan.json"));
  const auto& layers = plan["layers"];
  ASSERT_GE(layers.size(), 40U);
  EXPECT_EQ(layers.back()["exposure_us"].get<double>(), std::round(p.layers.exposure_s * 1e6));
}

TEST_F(ChosenProfiles, AreListedByTheSiteAndRefusedByNameWhereItHasThemNot) {
  start_both();
  EXPECT_THAT(telefab({"resins"}).output, AllOf(HasSubstr("clear "), HasSubstr("tinted"), HasSubstr("formlabs-clear")));
  EXPECT_THAT(telefab({"prints", "--names"}).output, HasSubstr("thin\n"));
  EXPECT_THAT(telefab({"machines", "--show", "toy", "--resin", "tinted"}).output, HasSubstr("inherited from"));
  const Outcome resin = submit({"--resin", "cleer"}), print = submit({"--print", "thick"});
  EXPECT_EQ(resin.code, 2);
  EXPECT_THAT(resin.errors, AllOf(HasSubstr("no resin named cleer"), HasSubstr("clear")));
  EXPECT_EQ(print.code, 2);
  EXPECT_THAT(print.errors, AllOf(HasSubstr("no print named thick"), HasSubstr("thin")));
}

TEST_F(ChosenProfiles, OfAResinThatIsNotInTheVatAreRefusedBeforeTheScanIsSliced) {
  load("clear");
  start_both();
  const Outcome other = submit({"--resin", "tinted"});
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.errors, HasSubstr("toy has the resin clear loaded, not tinted"));
  EXPECT_EQ(submit({"--resin", "clear", "--watch"}).code, 0);
  EXPECT_EQ(submit({"--watch"}).code, 0) << "what is loaded is what is printed with";
}

// The vat was filled with something else after the job was planned.
TEST_F(ChosenProfiles, OfAResinThatWasTakenOutOfTheVatPauseTheJobAndLightNothing) {
  load("clear");
  start_fab({"--start", "on-approval"});
  start_scan();
  const Outcome made = submit({"--resin", "clear"});
  ASSERT_EQ(made.code, 0) << made.errors;
  const std::string job = json::parse(made.output)["id"];
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("approve"), HasSubstr("awaiting-approval"));
  kill_fab();
  load("tinted");
  start_fab({"--start", "on-approval"});
  EXPECT_EQ(telefab({"approve", job, "--site", fab_site()}).code, 0);
  EXPECT_THAT(watch->wait_for_error_line("loaded"), HasSubstr("toy has the resin tinted loaded, not clear"));
  EXPECT_EQ(text_of(folder() / "fab" / "jobs" / job / "journal").find("exposing"), std::string::npos);
  kill_fab();
  load("clear");
  start_fab({"--start", "on-approval"});
  EXPECT_EQ(telefab({"resume", job, "--site", fab_site()}).code, 0);
  EXPECT_EQ(watch->finish(), 0) << watch->errors();
}

}  // namespace
}  // namespace telefab::test
