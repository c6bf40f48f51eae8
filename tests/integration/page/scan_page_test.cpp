// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/test/recording_scan_backend.hpp>
#include <telefab/test/recording_staging.hpp>

#include "accessible.hpp"
#include "screenshot.hpp"

namespace telefab::scan {
namespace {

class ScanPageTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::Browser::is_installed()) GTEST_SKIP() << "no chromium and chromedriver on this machine";
    browser = std::make_unique<test::Browser>();
    browser->open("http://127.0.0.1:" + std::to_string(server->port()) + "/");
    ASSERT_TRUE(says("#job-name", "statue"));
  }
  [[nodiscard]] bool says(const std::string& css, const std::string& text) const {
    return browser->becomes_true("return document.querySelector('" + css + "').textContent.includes('" + text + "');");
  }

  RecordingScanBackend backend;
  SystemClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  RecordingStaging staging;
  ScanWeb site{backend, staging, sign_in, {.version = "0.1.0"}};
  std::unique_ptr<WebServer> server = WebServer::listen({"127.0.0.1"}, site, "telefab-scan/0.1.0", clock).value();
  std::unique_ptr<test::Browser> browser;
};

TEST_F(ScanPageTest, ShowsStagesFiguresFlagsAndTheLine) {
  EXPECT_TRUE(says("#stages", "500 of 500 layers, 1.4 s"));
  EXPECT_TRUE(says("#stages", "77 of 520 layers"));
  EXPECT_TRUE(says("#job-line", "44.2 kB sent for a scan of 1234.6 kB"));
  EXPECT_TRUE(says("#figures", "499 of 500"));
  EXPECT_TRUE(says("#flags", "layer 41, z 6.225 mm: nearly level"));
  EXPECT_TRUE(says("#fab", "connection refused"));
  EXPECT_TRUE(says("#events", "printing"));
  test::keep_screenshot(*browser, "scan-page");
}

TEST_F(ScanPageTest, SearchesAmongJobsOfAnyAge) {
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#older').hidden;"));
  browser->type("#search", "nobody");
  EXPECT_TRUE(browser->becomes_true("return document.querySelectorAll('#jobs li').length === 0;"));
  EXPECT_TRUE(browser->becomes_true("return !document.querySelector('#none-found').hidden;"));
  EXPECT_TRUE(says("#job-name", "statue")) << "what is looked at stays";
  browser->run("const s = document.querySelector('#search'); s.value = 'STATUE'; s.oninput();");
  EXPECT_TRUE(browser->becomes_true("return document.querySelectorAll('#jobs li').length === 1;"));
}

TEST_F(ScanPageTest, AsksForEachReasonThatHoldsAJobAtTheFabBeforeItIsApproved) {
  backend.preflight_json =
      R"({"verdict":"held","items":[{"name":"carry","verdict":"held","text":"0.3 mm2 bear 3 MPa"},{"name":"time","verdict":"passed","text":"2 h"}]})";
  browser->run("state.jobs[0].state = 'awaiting-approval'; showJob();");
  browser->click("[data-action=approve]");
  browser->type("#token", "secret\n");
  ASSERT_TRUE(browser->becomes_true("return document.querySelector('#approval').open;"));
  EXPECT_TRUE(says("#approval-items", "0.3 mm2 bear 3 MPa"));
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#approval-go').disabled;"));
  test::keep_screenshot(*browser, "scan-page-approval");
  browser->click("#approval-0");
  browser->click("#approval-go");
  ASSERT_TRUE(says("#answer", "approve: accepted"));
  EXPECT_EQ(backend.although, "carry");
}

TEST_F(ScanPageTest, CancelsWithTheOperatorsToken) {
  browser->click("[data-action=cancel]");
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
  browser->type("#token", "secret\n");
  browser->accept_dialog();
  ASSERT_TRUE(says("#answer", "cancel: accepted"));
  ASSERT_EQ(backend.commands.size(), 1U);
  EXPECT_EQ(backend.commands[0].second, JobCommand::Cancel);
}

TEST_F(ScanPageTest, KeepsToContrastNamesAndTheTabKey) {
  browser->run("for (const each of document.querySelectorAll('details')) each.open = true; askToSignIn('nobody');");
  for (const char* scheme : {"light", "dark"}) {
    browser->prefer_colours(scheme);
    EXPECT_EQ(test::texts_without_contrast(*browser), "[]") << scheme;
  }
  EXPECT_EQ(test::faults_for_screen_readers(*browser), "[]");
  EXPECT_EQ(test::out_of_reach_of_tab(*browser), "[]");
}

TEST_F(ScanPageTest, FitsAPhoneAndAsksNobodyButItsOwnSite) {
  browser->resize(500, 900);  // the narrowest window of the desktop browser
  EXPECT_TRUE(browser->becomes_true("return document.documentElement.scrollWidth <= window.innerWidth;"));
  EXPECT_EQ(
      browser->run(
          "return performance.getEntriesByType('resource').filter((r) => !r.name.startsWith(location.origin)).length;"),
      0);
  test::keep_screenshot(*browser, "scan-page-phone");
}

}  // namespace
}  // namespace telefab::scan
