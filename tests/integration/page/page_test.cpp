// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/recording_backend.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/web/page_link.hpp>

#include "accessible.hpp"
#include "screenshot.hpp"

namespace telefab::fab {
namespace {

/// A backend whose one job can be paused, resumed and cancelled, with a failed job beside it.
class LivingBackend final : public RecordingBackend {
 public:
  [[nodiscard]] Result<std::vector<JobView>> jobs() override {
    const std::lock_guard lock{mutex_};
    JobView failed = job_;
    failed.id = "job-2";
    failed.name = "lion.ply";
    failed.owner = "grace";
    failed.state = JobState::Failed;
    failed.message = "layer 12 has an unsupported island at (12.1, 40.2) mm";
    return is_forgotten_ ? std::vector<JobView>{failed} : std::vector<JobView>{failed, job_};
  }
  /// Two pages: the second has a job that the list of the newest does not.
  [[nodiscard]] Result<JobViewPage> find(const JobQuery& query) override {
    const std::lock_guard lock{mutex_};
    EXPECT_EQ(query.states, (std::vector{JobState::Done, JobState::Failed, JobState::Cancelled}));
    JobView ancient = job_;
    ancient.id = "job-0";
    ancient.name = "ancient.ply";
    ancient.state = JobState::Done;
    if (query.words == "ancient") return JobViewPage{{ancient}, 0};
    if (!query.words.empty()) return JobViewPage{};
    return query.before == 0 ? JobViewPage{{}, 7} : JobViewPage{{ancient}, 0};
  }
  [[nodiscard]] Result<JobView> job(std::string_view) override {
    const std::lock_guard lock{mutex_};
    return job_;
  }
  [[nodiscard]] Result<std::string> layer_json(std::string_view, std::uint32_t layer) override {
    return fmt::format(
        R"({{"layer":{},"z_mm":{},"thickness_mm":1,"bounds":[0,0,40,30],"part":[[[10,5],[30,5],[30,25],[10,25]],[[15,10],[15,20],[25,20],[25,10]]],"supports":[[[2,2],[5,2],[5,5]]],"certificate":"certified"}})",
        layer, layer + 0.5);
  }
  [[nodiscard]] Result<void> act(std::string_view id, JobCommand action, std::string_view who) override {
    const std::lock_guard lock{mutex_};
    if (action == JobCommand::Forget && is_worked_on)
      return fail(ErrorCode::Conflict, "job job-1 is still worked on; forget it in a moment");
    (void)RecordingBackend::act(id, action, who);
    ++revision_;
    if (action == JobCommand::Forget) {
      is_forgotten_ = true;
      return {};
    }
    job_.state = action == JobCommand::Pause    ? JobState::Paused
                 : action == JobCommand::Cancel ? JobState::Cancelled
                                                : JobState::Printing;
    job_.exposure_unknown = false;
    return {};
  }
  [[nodiscard]] std::uint64_t revision() override { return revision_; }
  void leave_exposure_unknown() {
    const std::lock_guard lock{mutex_};
    job_.state = JobState::Paused;
    job_.message = "layer 7 was perhaps exposed: decide whether to expose it again";
    job_.exposure_unknown = true;
    ++revision_;
  }
  void wait_for_approval() {
    const std::lock_guard lock{mutex_};
    job_.state = JobState::AwaitingApproval;
    ++revision_;
  }
  std::atomic<bool> is_worked_on{false};

 private:
  static JobView printing() {
    JobView job;
    job.id = "job-1";
    job.name = "statue.ply";
    job.machine = "machine-a";
    job.state = JobState::Printing;
    job.layers = 20;
    job.layers_printed = 7;
    job.progress = 0.35;
    job.seconds_left = 125;
    return job;
  }
  std::mutex mutex_;
  JobView job_ = printing();
  bool is_forgotten_ = false;
  std::atomic<std::uint64_t> revision_{1};
};

class PageTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::Browser::is_installed()) GTEST_SKIP() << "no chromium and chromedriver on this machine";
    browser = std::make_unique<test::Browser>();
    browser->open(fmt::format("http://127.0.0.1:{}/", server->port()));
    ASSERT_TRUE(browser->becomes_true("return document.querySelector('#job-name').textContent === 'statue.ply';"));
  }
  void keep_screenshot(const std::string& name) const { test::keep_screenshot(*browser, name); }
  [[nodiscard]] bool says(const std::string& css, const std::string& text) const {
    return browser->becomes_true(
        fmt::format("return document.querySelector('{}').textContent.includes('{}');", css, text));
  }

  LivingBackend backend;
  SystemClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  FabWeb site{backend, sign_in, {.version = "0", .three_js = ""}};
  std::unique_ptr<WebServer> server = WebServer::listen({"127.0.0.1"}, site, "telefab-fab/0", clock).value();
  std::unique_ptr<test::Browser> browser;
};

TEST_F(PageTest, ShowsTheJobItsLayerAndTheMachine) {
  EXPECT_TRUE(says("#job-count", "layer 7 of 20, 2 min 5 s left"));
  EXPECT_TRUE(says("#devices", "virtual"));
  EXPECT_TRUE(
      browser->becomes_true("const p = document.querySelector('#contours').getContext('2d').getImageData(180, 240, 1, "
                            "1).data; return p[3] === 255;"));
  keep_screenshot("page");
}

TEST_F(PageTest, PausesResumesAndCancelsWithTheOperatorsToken) {
  browser->click("[data-action=pause]");
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
  browser->type("#token", "secret\n");
  ASSERT_TRUE(says("#job-line", "paused"));
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('[data-action=pause]').disabled;"));
  browser->click("[data-action=resume]");
  ASSERT_TRUE(says("#job-line", "printing"));
  browser->click("[data-action=cancel]");
  browser->accept_dialog();
  ASSERT_TRUE(says("#job-line", "cancelled"));
  EXPECT_TRUE(
      browser->becomes_true("return "
                            "[...document.querySelectorAll('[data-action]:not([data-action=forget]):not([data-action="
                            "again])')].every((b) => b.disabled);"));
  EXPECT_EQ(backend.actions.size(), 3U);
}

TEST_F(PageTest, ForgetsAJobThatHasEndedAndSaysWhyAnotherStays) {
  EXPECT_TRUE(browser->becomes_true(
      "const b = document.querySelector('[data-action=forget]'); return b.disabled && b.title.includes('has ended');"));
  browser->click("[data-action=cancel]");
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
  browser->type("#token", "secret\n");
  browser->accept_dialog();
  ASSERT_TRUE(says("#job-line", "cancelled"));
  backend.is_worked_on = true;
  browser->click("[data-action=forget]");
  browser->accept_dialog();
  ASSERT_TRUE(says("#answer", "forget it in a moment"));
  EXPECT_TRUE(says("#job-name", "statue.ply"));
  backend.is_worked_on = false;
  browser->click("[data-action=forget]");
  browser->accept_dialog();
  ASSERT_TRUE(says("#job-name", "lion.ply")) << "the page shows what is left";
  EXPECT_TRUE(browser->becomes_true("return !document.querySelector('[data-job=job-1]');"));
  ASSERT_EQ(backend.actions.size(), 2U);
  EXPECT_EQ(backend.actions[1].second, JobCommand::Forget);
}

TEST_F(PageTest, AsksWhatBecameOfALayerPerhapsExposedAndPassesTheAnswerOn) {
  const auto hidden = [](const char* css) {
    return fmt::format("return getComputedStyle(document.querySelector('{}')).display === 'none';", css);
  };
  EXPECT_TRUE(browser->becomes_true(hidden("[data-as=expose-again]")));
  backend.leave_exposure_unknown();
  ASSERT_TRUE(says("#job-message", "perhaps exposed"));
  EXPECT_TRUE(browser->becomes_true(hidden("[data-action=resume]:not([data-as])")));
  keep_screenshot("page-unknown");
  browser->click("[data-as=expose-again]");
  browser->type("#token", "secret\n");
  ASSERT_TRUE(says("#answer", "resume as expose-again: accepted"));
  ASSERT_TRUE(browser->becomes_true(hidden("[data-as=expose-again]")));
  ASSERT_EQ(backend.actions.size(), 1U);
  EXPECT_EQ(backend.actions[0].second, JobCommand::ExposeAgain);
}

TEST_F(PageTest, ShowsWhatEachMachineIsAtAndSaysThatOnesPlatformIsEmpty) {
  ASSERT_TRUE(browser->becomes_true("return document.querySelectorAll('#machines li').length === 4;"));
  EXPECT_TRUE(says("#machines [data-state=printing]", "layer 1 of 3, 1 min 24 s left"));
  EXPECT_TRUE(says("#machines [data-state=printing]", "2 waiting"));
  EXPECT_TRUE(says("#machines [data-state=printing] .moment", "exposing · light on · z 0.40 mm · resin 24.5 °C"));
  EXPECT_TRUE(says("#machines [data-state=fault]", "the stage does not answer"));
  EXPECT_TRUE(says("#machines [data-state=idle]", "machine-b, resin tough"));
  keep_screenshot("page-machines");
  browser->click("#machines [data-state=occupied] button:not(.job)");
  browser->type("#token", "secret\n");
  ASSERT_TRUE(says("#answer", "cleared: accepted"));
  EXPECT_EQ(backend.cleared, std::vector<std::string>{"hall-2"});
}

TEST_F(PageTest, LooksAtThePrintThatRunsAndNotAtANewerJobThatHasEnded) {
  ASSERT_TRUE(browser->becomes_true("return document.querySelector('#history [data-job=job-2]') !== null;"));
  EXPECT_TRUE(browser->becomes_true(
      "return document.querySelector('#queue [data-job=job-1]').getAttribute('aria-current') === 'true';"));
}

TEST_F(PageTest, OffersNothingThatCannotBeDoneNow) {
  const auto offered = [&] {
    return browser->run(
        "return [...document.querySelectorAll('[data-action]')].filter((b) => b.offsetParent).map((b) "
        "=> (b.disabled ? 'off ' : '') + b.dataset.action).join(' ');");
  };
  EXPECT_EQ(offered(), "pause cancel");
  browser->click("[data-job=job-2]");
  ASSERT_TRUE(says("#job-name", "lion.ply"));
  EXPECT_EQ(offered(), "again forget");
}

TEST_F(PageTest, FindsWhatWasMadeByItsOwner) {
  ASSERT_TRUE(browser->becomes_true("return document.querySelectorAll('#history li').length === 1;"));
  browser->type("#search", "nobody");
  EXPECT_TRUE(browser->becomes_true("return document.querySelectorAll('#history li').length === 0;"));
  EXPECT_TRUE(says("#none-found", "fits"));
  browser->run("const s = document.querySelector('#search'); s.value = 'GRACE failed'; s.oninput();");
  EXPECT_TRUE(browser->becomes_true("return document.querySelectorAll('#history li').length === 1;"));
}

TEST_F(PageTest, ShowsJobsOfAnyAgePageByPageAndByTheirWords) {
  const auto history = [&](const std::string& names) {
    return browser->becomes_true(
        "return [...document.querySelectorAll('#history b')].map((b) => b.textContent).join() === '" + names + "';");
  };
  ASSERT_TRUE(history("lion.ply"));
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#older').hidden;"));
  browser->click("#older");
  EXPECT_TRUE(history("lion.ply,ancient.ply"));
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#older').hidden;")) << "there is no more";
  browser->click("[data-job=job-0]");
  EXPECT_TRUE(says("#job-name", "ancient.ply"));
  backend.leave_exposure_unknown();  // the stream tells of the newest, and of this one nothing
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#queue small').textContent.includes('paused');"));
  EXPECT_TRUE(says("#job-name", "ancient.ply")) << "it stays the one that is looked at";
  browser->type("#search", "Ancient");
  EXPECT_TRUE(history("ancient.ply"));
  keep_screenshot("history");
}

TEST_F(PageTest, PrintsAgainWhatWasMadeBefore) {
  browser->click("[data-job=job-2]");
  ASSERT_TRUE(says("#job-name", "lion.ply"));
  browser->click("[data-action=again]");
  browser->type("#token", "secret\n");
  // The backend knows no layers of that one, and says so.
  ASSERT_TRUE(says("#answer", "not all layers of the job are here"));
  EXPECT_EQ(backend.printed_again, 0);
}

TEST_F(PageTest, AsksForEachReasonThatHoldsAJobBeforeItIsApproved) {
  backend.wait_for_approval();
  ASSERT_TRUE(says("#job-line", "awaiting approval"));
  browser->click("[data-action=approve]");
  browser->type("#token", "secret\n");
  ASSERT_TRUE(browser->becomes_true("return document.querySelector('#approval').open;"));
  EXPECT_TRUE(says("#approval-items", "1 found <b>"));
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#approval-go').disabled;"));
  keep_screenshot("page-approval");
  browser->click("#approval button[value='']");
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#approval').open;"));
  EXPECT_TRUE(backend.approvals.empty()) << "whoever puts it off has approved nothing";
  browser->click("[data-action=approve]");
  ASSERT_TRUE(browser->becomes_true("return document.querySelector('#approval').open;"));
  browser->click("#approval-0");
  browser->click("#approval-go");
  ASSERT_TRUE(says("#answer", "approve: accepted"));
  ASSERT_EQ(backend.approvals.size(), 1U);
  EXPECT_EQ(backend.approvals[0], (std::pair<std::string, std::string>{"job-1", "islands"}));
}

TEST_F(PageTest, MarksThePlacesOfAReportAndGoesToThem) {
  browser->run(
      "state.issues = issuesOf({ plan: { check: { findings: [{ kind: 'suction-cup', holds_the_job: false, layer: 4, "
      "last_layer: 6, x_mm: 20, y_mm: 15, size_mm2: 2.5 }] }, carry: { weak: { places: [{ layer: 9, place: [12, 7], "
      "demand: 300, section_mm2: 0.2 }] } } } }); showIssues(); document.querySelector('#issues-box').open = true;");
  EXPECT_TRUE(says("#issues-count", "2 places to look at, 1 of them hold the job"));
  EXPECT_TRUE(says("#issues li", "layer 9: may tear")) << "what holds the job comes first";
  browser->click("#issues li:nth-child(2) button");
  EXPECT_TRUE(says("#layer-number", "4, z 4.50 mm"));
  // Its ring on the canvas, in the middle of the picture.
  EXPECT_TRUE(browser->becomes_true(
      "const c = document.querySelector('#contours'), d = c.getContext('2d').getImageData(c.width / 2 - 20, c.height / "
      "2 - 20, 40, 40).data; return d.some((v, i) => i % 4 === 0 && v > 140 && d[i + 1] < 60 && d[i + 2] < 60);"));
}

TEST_F(PageTest, RefusesAWrongTokenAndAsksAgain) {
  browser->click("[data-action=pause]");
  browser->type("#token", "wrong\n");
  ASSERT_TRUE(says("#sign-in-answer", "nobody"));
  EXPECT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
  EXPECT_TRUE(backend.actions.empty());
}

TEST_F(PageTest, ShowsWhyAJobFailed) {
  browser->click("[data-job=job-2]");
  ASSERT_TRUE(says("#job-message", "unsupported island"));
  keep_screenshot("page-failed");
}

TEST_F(PageTest, ShowsWhatHoldsAJobBeforeItIsPrinted) {
  EXPECT_TRUE(says("#preflight .held", "1 found <b>"));
  EXPECT_TRUE(says("#preflight-count", "1 passed"));
  EXPECT_TRUE(says("#preflight-passed .passed", "2 h 3 min"));
}

TEST_F(PageTest, DrawsTheDosePlannedAndMeasured) {
  EXPECT_TRUE(says("#dose-text", "first layer 108.0 mJ/cm\u00b2, last 27.0 mJ/cm\u00b2; 2 of 4 layers measured"));
  EXPECT_TRUE(
      browser->becomes_true("const c = document.querySelector('#dose'); return c.getContext('2d').getImageData(0, 0, "
                            "c.width, c.height).data.some((v) => v !== 0);"));
}

TEST_F(PageTest, ShowsTheAccuracyOfThePredictedPartOnceItIsThere) {
  EXPECT_TRUE(
      browser->becomes_true("return !document.querySelector('#accuracy-box').hidden && "
                            "document.querySelector('#accuracy').src.includes('/v1/jobs/job-1/accuracy.png?plan=');"));
  // However large the picture, the page stays as wide as its window.
  EXPECT_TRUE(browser->becomes_true(
      "document.querySelector('#accuracy-box').open = true; const image = document.querySelector('#accuracy'); "
      "image.width = 5000; return document.documentElement.scrollWidth <= window.innerWidth;"));
}

TEST_F(PageTest, HasEnoughContrastInEveryTextByDayAndInTheDark) {
  browser->run("for (const each of document.querySelectorAll('details')) each.open = true; askToSignIn('nobody');");
  for (const char* scheme : {"light", "dark"}) {
    browser->prefer_colours(scheme);
    EXPECT_EQ(test::texts_without_contrast(*browser), "[]") << scheme;
  }
}

TEST_F(PageTest, NamesWhatItShowsForScreenReaders) {
  browser->run("for (const each of document.querySelectorAll('details')) each.open = true; askToSignIn('nobody');");
  EXPECT_EQ(test::faults_for_screen_readers(*browser), "[]");
}

TEST_F(PageTest, EveryControlIsReachedByTheTabKey) {
  browser->run("for (const each of document.querySelectorAll('details')) each.open = true;");
  EXPECT_EQ(test::out_of_reach_of_tab(*browser), "[]");
}

TEST_F(PageTest, ScrubsToAnyLayerByKeyboard) {
  browser->type("#layer", "\xEE\x80\x90");  // U+E010, the End key in WebDriver
  EXPECT_TRUE(says("#layer-number", "19"));
  EXPECT_TRUE(browser->becomes_true("return !document.querySelector('#follow').checked;"));
}

TEST_F(PageTest, IsUsedFromPauseToCancelByKeyboardAloneWithTheFocusInSight) {
  // Keys in WebDriver's private area.
  const std::string tab = "\xEE\x80\x84", enter = "\xEE\x80\x87";
  const auto go_to = [&](const std::string& css) {
    for (int presses = 0; presses < 60; ++presses) {
      browser->press({tab});
      if (!browser->run(fmt::format("return document.activeElement.matches('{}');", css)).get<bool>()) continue;
      return browser
          ->run(
              "const s = getComputedStyle(document.activeElement); return s.outlineStyle !== 'none' && "
              "parseFloat(s.outlineWidth) >= 1;")
          .get<bool>();
    }
    return false;
  };
  ASSERT_TRUE(go_to("[data-action=pause]"));
  browser->press({enter});
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
  if (!browser->run("return document.activeElement.id === 'token';").get<bool>()) {
    ASSERT_TRUE(go_to("#token"));
  }
  browser->press({"s", "e", "c", "r", "e", "t", enter});
  ASSERT_TRUE(says("#job-line", "paused"));
  ASSERT_TRUE(go_to("[data-action=resume]"));
  browser->press({enter});
  ASSERT_TRUE(says("#job-line", "printing"));
  for (const char* css : {"#layer", "#turn", "#jobs button"}) EXPECT_TRUE(go_to(css)) << css;
  ASSERT_TRUE(go_to("[data-action=cancel]"));
  browser->press({enter});
  browser->accept_dialog();
  ASSERT_TRUE(says("#job-line", "cancelled"));
  EXPECT_EQ(backend.actions.size(), 3U);
}

TEST_F(PageTest, AsksNobodyButItsOwnSite) {
  EXPECT_TRUE(says("#devices", "virtual"));
  EXPECT_EQ(
      browser->run(
          "return performance.getEntriesByType('resource').filter((r) => !r.name.startsWith(location.origin)).length;"),
      0);
}

TEST_F(PageTest, FitsAPhone) {
  browser->resize(500, 900);  // the narrowest window of the desktop browser
  EXPECT_TRUE(browser->becomes_true("return document.documentElement.scrollWidth <= window.innerWidth;"));
  keep_screenshot("page-phone");
}

/// The same where operators have tokens of their own.
class SignInPage : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::Browser::is_installed()) GTEST_SKIP() << "no chromium and chromedriver on this machine";
    browser = std::make_unique<test::Browser>();
    browser->open(fmt::format("http://127.0.0.1:{}/", server->port()));
  }
  [[nodiscard]] bool says(const std::string& css, const std::string& text) const {
    return browser->becomes_true(
        fmt::format("return document.querySelector('{}').textContent.includes('{}');", css, text));
  }

  SystemClock clock;
  test::ScratchFolder scratch;
  std::filesystem::path folder = scratch.path();
  std::string ada = add_operator_token(folder / "operator-tokens", "ada", Access::Operators, {}).value();
  LivingBackend backend;
  SignIn sign_in{{folder / "operator-tokens", "secret"}, clock};
  FabWeb site{backend, sign_in, {}};
  std::unique_ptr<WebServer> server = WebServer::listen({"127.0.0.1"}, site, "telefab-fab/0", clock).value();
  std::unique_ptr<test::Browser> browser;
};

TEST_F(SignInPage, ShowsNothingBeforeTheSignInAndNothingAfterTheSignOut) {
  ASSERT_TRUE(says("#link", "not signed in"));
  EXPECT_TRUE(
      browser->becomes_true("return !document.querySelector('#token-form').hidden && "
                            "document.activeElement.id === 'token';"));
  EXPECT_FALSE(browser->run("return document.body.textContent.includes('statue');").get<bool>());
  test::keep_screenshot(*browser, "page-sign-in");
  browser->type("#token", "secret\n");
  ASSERT_TRUE(says("#sign-in-answer", "nobody")) << "the shared token names no person";
  browser->type("#token", ada + "\n");
  ASSERT_TRUE(says("#visitor-name", "ada"));
  ASSERT_TRUE(says("#job-name", "statue.ply"));
  EXPECT_TRUE(
      browser->becomes_true("return document.querySelector('#token-form').hidden && "
                            "document.querySelector('#mask').naturalWidth >= 0;"));
  EXPECT_EQ(browser->run("return document.cookie + Object.keys(sessionStorage) + Object.keys(localStorage);"), "")
      << "no script can read what the operator signed in with";
  browser->click("[data-action=pause]");
  ASSERT_TRUE(says("#job-line", "paused"));
  EXPECT_EQ(backend.names, std::vector<std::string>{"ada"});
  test::keep_screenshot(*browser, "page-signed-in");
  browser->click("#sign-out");
  ASSERT_TRUE(says("#link", "not signed in"));
  EXPECT_FALSE(browser->run("return document.body.textContent.includes('statue');").get<bool>());
}

TEST_F(SignInPage, SendsAChosenFileOnceSomebodyHasSignedIn) {
  const auto file = folder / "Büste 1.sl1";
  std::ofstream{file} << "layers";
  ASSERT_TRUE(says("#link", "not signed in"));
  browser->type("#file", file.string());
  browser->click("#file-form button");
  EXPECT_TRUE(browser->becomes_true("return document.activeElement.id === 'token';"));
  EXPECT_TRUE(backend.files.empty());
  browser->type("#token", ada + "\n");
  ASSERT_TRUE(says("#visitor-name", "ada"));
  browser->click("#file-form button");
  ASSERT_TRUE(says("#file-answer", "is job job-1")) << browser->run("return document.body.textContent;");
  ASSERT_EQ(backend.files.size(), 1U);
  EXPECT_EQ(backend.files[0].name, "Büste 1.sl1");
  EXPECT_EQ(backend.files[0].content, "layers");
  EXPECT_FALSE(backend.files[0].start) << "it waits for approval";
  test::keep_screenshot(*browser, "page-file-sent");
  const auto mesh = folder / "lion.stl";
  std::ofstream{mesh} << "solid";
  browser->type("#file", mesh.string());
  browser->click("#file-form button");
  EXPECT_TRUE(says("#file-answer", "scan or a mesh"));
  EXPECT_EQ(backend.files.size(), 1U);
}

TEST_F(SignInPage, AsksAgainWhereTheTokenWasRevokedUnderAnOpenPage) {
  browser->type("#token", ada + "\n");
  ASSERT_TRUE(says("#job-name", "statue.ply"));
  ASSERT_TRUE(revoke_operator_token(folder / "operator-tokens", "ada"));
  browser->click("[data-action=pause]");
  EXPECT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
  EXPECT_TRUE(backend.actions.empty());
}

/// Where nobody has a token yet.
TEST(LinkedPage, SignsInByALinkOnceAndKeepsItOutOfTheAddress) {
  if (!test::Browser::is_installed()) GTEST_SKIP() << "no chromium and chromedriver on this machine";
  SystemClock clock;
  const test::ScratchFolder scratch;
  const auto key_file = scratch.path() / "page-link";
  LivingBackend backend;
  SignIn sign_in{{{}, "secret", false, key_file}, clock};
  FabWeb site{backend, sign_in, {}};
  const auto server = WebServer::listen({"127.0.0.1"}, site, "telefab-fab/0", clock).value();
  const std::string address = fmt::format("http://127.0.0.1:{}", server->port());
  const std::string link = page_link(address, make_page_key(key_file, clock.wall()).value());
  test::Browser browser;
  browser.open(link);
  ASSERT_TRUE(browser.becomes_true("return document.querySelector('#visitor-name').textContent === 'web';"));
  EXPECT_EQ(browser.run("return location.href;"), address + "/");
  EXPECT_TRUE(browser.run("return document.querySelector('#token-form').hidden;").get<bool>());
  ASSERT_TRUE(browser.becomes_true("return !document.querySelector('[data-action=pause]').hidden;"));
  browser.click("[data-action=pause]");
  EXPECT_TRUE(browser.becomes_true("return document.querySelector('#job-line').textContent.includes('paused');"));
  browser.click("#sign-out");
  ASSERT_TRUE(browser.becomes_true("return document.querySelector('#visitor').hidden;"));
  // The page is open: the browser changes what stands behind "#" alone.
  browser.run("location.href = '" + link + "';");
  EXPECT_TRUE(browser.becomes_true(
      "return document.querySelector('#sign-in-answer').textContent.includes('opens nothing any more');"));
  test::keep_screenshot(browser, "page-link-used");
}

}  // namespace
}  // namespace telefab::fab
