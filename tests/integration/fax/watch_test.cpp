// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <memory>
#include <telefab/test/two_sites.hpp>

#include "terminal.hpp"

namespace telefab::test {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* kEnter = "\x1b[?1049h";
constexpr const char* kLeave = "\x1b[?1049l";

class Watch : public TwoSites {
 protected:
  void SetUp() override {
    set_machine(20);
    start_both();
    job = submit_torus();
  }
  [[nodiscard]] std::unique_ptr<Terminal> watch(std::vector<std::string> more = {}) const {
    std::vector<std::string> command{std::string{::getenv("TELEFAB_BIN")} + "/telefab", "watch", job, "--site",
                                     scan_site()};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Terminal>(command, 100, 30);
  }
  std::string job;
};

TEST_F(Watch, FillsTheTerminalFollowsItsSizeAndLeavesWithQ) {
  const auto terminal = watch();
  ASSERT_TRUE(terminal->wait_for(kEnter));
  ASSERT_TRUE(terminal->wait_for("\x1b[30;1Hq leaves"));
  ASSERT_TRUE(terminal->wait_for("torus.xyz"));
  ASSERT_TRUE(terminal->wait_for("printing: "));
  terminal->resize(60, 12);
  EXPECT_TRUE(terminal->wait_for("\x1b[2J"));
  EXPECT_TRUE(terminal->wait_for("\x1b[12;1Hq leaves"));
  terminal->type("q");
  EXPECT_TRUE(terminal->wait_for(kLeave));
  EXPECT_EQ(terminal->finish(), 0);
  EXPECT_TRUE(terminal->is_as_before());
  // The job goes on.
  EXPECT_EQ(telefab({"cancel", job}).code, 0);
}

TEST_F(Watch, RestoresTheTerminalHoweverItEnds) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGABRT}) {
    const auto terminal = watch();
    ASSERT_TRUE(terminal->wait_for("torus.xyz"));
    EXPECT_FALSE(terminal->is_as_before());
    terminal->send_signal(signal);
    EXPECT_TRUE(terminal->wait_for(kLeave)) << signal;
    (void)terminal->finish();
    EXPECT_TRUE(terminal->is_as_before()) << signal;
  }
  const auto terminal = watch({"--patience-min", "0"});
  ASSERT_TRUE(terminal->wait_for("torus.xyz"));
  kill_scan();
  EXPECT_TRUE(terminal->wait_for(kLeave));
  EXPECT_NE(terminal->finish(), 0);
  EXPECT_TRUE(terminal->is_as_before());
}

using WatchOverBreaks = TwoSites;

TEST_F(WatchOverBreaks, GoesOnWhereTheSiteStartsAgain) {
  set_machine(2);
  start_both();
  const std::string job = submit_torus();
  const auto follower = telefab_begun({"watch", job, "--plain"});
  EXPECT_THAT(follower->wait_for_error_line("printing"), HasSubstr("printing"));
  for (int breaks = 0; breaks < 2; ++breaks) {
    kill_scan();
    EXPECT_THAT(follower->wait_for_error_line("trying again"), HasSubstr("trying again"));
    start_scan();
    EXPECT_THAT(follower->wait_for_error_line("printing"), HasSubstr("printing"));
  }
  ASSERT_EQ(telefab({"cancel", job}).code, 0);
  EXPECT_EQ(follower->finish(), 6) << "cancelled, as it was seen to be";
}

TEST_F(Watch, PrintsLinesWithPlainEvenOnATerminal) {
  const auto terminal = watch({"--plain"});
  ASSERT_TRUE(terminal->wait_for("printing: "));
  terminal->send_signal(SIGTERM);
  (void)terminal->finish();
  EXPECT_THAT(terminal->written(), Not(HasSubstr("\x1b")));
}

}  // namespace
}  // namespace telefab::test
