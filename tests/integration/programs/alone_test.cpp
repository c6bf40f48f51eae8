// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <telefab/base/exit_code.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/test/toy.hpp>
#include <telefab/test/two_sites.hpp>

// A program that was copied to another computer, run by somebody who has nothing else of Telefab.
namespace telefab::test {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

class Alone : public testing::Test {
 protected:
  void SetUp() override {
    before_ = fs::current_path();
    fs::create_directories(root_ / "bin");
    fs::create_directories(root_ / "work");
    for (const char* program : {"telefab-scan", "telefab-fab"})
      fs::copy_file(fs::path{::getenv("TELEFAB_BIN")} / program, root_ / "bin" / program);
    fs::current_path(root_ / "work");
    std::ofstream cloud{"ball.xyz"};
    constexpr int kPoints = 6000;
    for (int i = 0; i < kPoints; ++i) {
      const double z = 1 - 2 * (i + 0.5) / kPoints, r = std::sqrt(1 - z * z),
                   turn = i * std::numbers::pi * (3 - std::sqrt(5.0));
      const double x = r * std::cos(turn), y = r * std::sin(turn);
      cloud << fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f}\n", 5 * x, 5 * y, 5 * z, x, y, z);
    }
  }
  void TearDown() override { fs::current_path(before_); }
  /// In an empty environment.
  [[nodiscard]] Outcome ran(const std::string& program, Words words) const {
    words.insert(words.begin(), {"/usr/bin/env", "-i", (root_ / "bin" / program).string()});
    return run(words);
  }
  ScratchFolder scratch_;
  fs::path root_ = scratch_.path(), before_;
};

TEST_F(Alone, SlicesPlansAndVerifiesByBuiltInProfiles) {
  const Outcome sliced = ran("telefab-scan", {"slice", "ball.xyz", "--machine", "machine-b", "--height-mm", "3",
                                              "--out", "ball.tfc", "--preview", "ball.png"});
  EXPECT_EQ(sliced.code, 0) << sliced.errors;
  const Outcome planned = ran("telefab-fab", {"plan", "ball.tfc", "--out", "ball-plan"});
  EXPECT_EQ(planned.code, 0) << planned.errors;
  const Outcome verified = ran("telefab-fab", {"verify", "ball-plan"});
  EXPECT_EQ(verified.code, 0) << verified.errors << verified.output;
}

TEST_F(Alone, TakesTheProfilesThatLieBesideTheProgram) {
  fs::create_directories(root_ / "bin/machines");
  const Outcome keys = ran("telefab-fab", {"machines"});
  ASSERT_EQ(keys.code, 0) << keys.errors;
  EXPECT_THAT(keys.output, testing::HasSubstr("machine-a"));
  std::ofstream{root_ / "bin/machines/toy.toml"} << kToyProfile;
  const Outcome own = ran("telefab-fab", {"machines"});
  ASSERT_EQ(own.code, 0) << own.errors;
  EXPECT_TRUE(own.output.starts_with("toy")) << own.output;
  EXPECT_THAT(own.output, testing::Not(testing::HasSubstr("machine-a")));
}

TEST_F(Alone, OrientAsksThePlannerThatLiesBesideItAndDoesWithout) {
  const Words ask{"orient",       "ball.xyz", "--machine", "machine-b", "--height-mm", "3",
                  "--directions", "4",        "--best",    "2",         "--json"};
  const auto judged_by = [](const Outcome& outcome) {
    EXPECT_EQ(outcome.code, 0) << outcome.errors;
    const auto json = nlohmann::json::parse(outcome.output, nullptr, false);
    EXPECT_FALSE(json.is_discarded()) << outcome.output;
    return json.is_discarded() ? std::string{} : json["best"][0]["judged_by"].get<std::string>();
  };
  EXPECT_EQ(judged_by(ran("telefab-scan", ask)), "planner");
  fs::remove(root_ / "bin/telefab-fab");
  EXPECT_EQ(judged_by(ran("telefab-scan", ask)), "estimate");
  Words missing = ask;
  missing.insert(missing.end(), {"--planner", "./telefab-fab"});
  const Outcome refused = ran("telefab-scan", missing);
  EXPECT_EQ(refused.code, static_cast<int>(exit_code_for(ErrorCode::NotFound))) << refused.errors;
  EXPECT_THAT(refused.errors, testing::HasSubstr("no program ./telefab-fab"));
}

TEST_F(Alone, PlatformsAndSupportsAreThoseOfAMachine) {
  const auto refusal = [&](const Words& words, ExitCode code = ExitCode::Refused) {
    Words inspect{"inspect", "ball.xyz"};
    inspect.insert(inspect.end(), words.begin(), words.end());
    const Outcome outcome = ran("telefab-scan", inspect);
    EXPECT_EQ(outcome.code, static_cast<int>(code)) << outcome.output;
    return outcome.errors;
  };
  EXPECT_THAT(refusal({"--up", "auto"}), testing::HasSubstr("--machine"));
  EXPECT_THAT(refusal({"--position", "3,4"}), testing::HasSubstr("--machine"));
  EXPECT_THAT(refusal({"--rotate", "1,0,0,0,1,0,0,0,-1"}, ExitCode::Usage), testing::HasSubstr("mirror"));
}

TEST_F(Alone, RegisterTakesAFoldersScansInAnyLettersAndNamesOneWithout) {
  fs::create_directories("views");
  fs::create_directories("none");
  const Outcome made = ran("telefab-scan", {"digitize", "--shape", "knot", "--height-mm", "20", "--step-deg", "60",
                                            "--tilt-deg", "30", "--out", "views"});
  ASSERT_EQ(made.code, 0) << made.errors;
  for (int i = 0; i < 6; ++i)
    fs::rename(fmt::format("views/view_{:03}.ply", i), fmt::format("views/VIEW_{:03}.PLY", i));
  const Outcome joined = ran("telefab-scan", {"register", "views", "--step-deg", "60", "--out", "knot.ply", "--json"});
  EXPECT_EQ(joined.code, 0) << joined.errors;
  EXPECT_EQ(nlohmann::json::parse(joined.output)["views"], 6);
  for (const Words& folders : {Words{"none"}, Words{"views", "none"}}) {
    Words words{"register", "--out", "x.ply"};
    words.insert(words.end(), folders.begin(), folders.end());
    const Outcome refused = ran("telefab-scan", words);
    EXPECT_EQ(refused.code, static_cast<int>(ExitCode::Refused)) << refused.output;
    EXPECT_THAT(refused.errors, testing::HasSubstr("none: no scan is in this folder"));
  }
}

}  // namespace
}  // namespace telefab::test
