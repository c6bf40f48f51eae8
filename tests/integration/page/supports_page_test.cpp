// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <mutex>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/recording_backend.hpp>

#include "screenshot.hpp"

// Supports by hand at the fab's page: what an operator clicks becomes the list that the job is planned again with.

namespace telefab::fab {
namespace {

using nlohmann::json;
using testing::SizeIs;

/// A plate on a leg: print layer 0 is below the part, 1 to 3 are the leg, the rest is the plate. One pin of the
/// planner's, and those by hand as they were asked for last. Planning takes until finish_planning().
class PlateBackend final : public RecordingBackend {
 public:
  [[nodiscard]] Result<std::vector<JobView>> jobs() override {
    return job("job-1").map([](const JobView& view) { return std::vector{view}; });
  }
  [[nodiscard]] Result<JobView> job(std::string_view) override {
    const std::lock_guard lock{mutex_};
    JobView view;
    view.id = "job-1";
    view.name = "plate.ply";
    view.machine = "machine-a";
    view.state = is_planning_ ? JobState::Planning : state_;
    view.message = message_;
    view.layers = is_planning_ ? 0 : 20;
    view.progress = is_planning_ ? 0.4 : 0;
    return view;
  }
  [[nodiscard]] Result<std::string> layer_json(std::string_view, std::uint32_t layer) override {
    const char* part = layer == 0  ? ""
                       : layer < 4 ? "[[10,5],[14,5],[14,9],[10,9]]"
                                   : "[[10,5],[30,5],[30,25],[10,25]]";
    return fmt::format(
        R"({{"layer":{},"z_mm":{},"thickness_mm":0.2,"bounds":[8,3,32,27],"part":[{}],"supports":[],"certificate":"certified"}})",
        layer, layer * 0.2 + 0.1, part);
  }
  [[nodiscard]] Result<std::string> preflight(std::string_view) override {
    const std::lock_guard lock{mutex_};
    return std::string{
        hand_["extra"].empty()
            ? R"({"items":[{"name":"islands","verdict":"passed","text":"none"},{"name":"carry","verdict":"held","text":"layer 4 bears too much"}]})"
            : R"({"items":[{"name":"islands","verdict":"passed","text":"none"},{"name":"carry","verdict":"passed","text":"it carries"}]})"};
  }
  [[nodiscard]] Result<std::string> supports(std::string_view) override {
    const std::lock_guard lock{mutex_};
    json anchors = json::array();
    const json own = {{"x_mm", 26.0},    {"y_mm", 20.0},     {"part_layer", 3}, {"z_mm", 0.7},
                      {"tip", "medium"}, {"on_part", false}, {"by_hand", false}};
    if (hand_["removed"].empty()) anchors.push_back(own);
    for (const json& e : hand_["extra"])
      anchors.push_back({{"x_mm", e["x_mm"]},
                         {"y_mm", e["y_mm"]},
                         {"part_layer", 3},
                         {"z_mm", 0.7},
                         {"tip", "light"},
                         {"on_part", false},
                         {"by_hand", true}});
    return json{{"elevation_layers", 1}, {"thickness_mm", 0.2}, {"anchors", anchors}, {"hand", hand_}}.dump();
  }
  [[nodiscard]] Result<void> plan_again(std::string_view id, std::string_view list, std::string_view who) override {
    const std::lock_guard lock{mutex_};
    if (!can_plan)
      message_ = "the plan is that of before, since no other could be made: too tall";
    else
      hand_ = json::parse(list);
    is_planning_ = true;
    ++revision_;
    return RecordingBackend::plan_again(id, list, who);
  }
  [[nodiscard]] std::uint64_t revision() override { return revision_; }
  void finish_planning() {
    const std::lock_guard lock{mutex_};
    is_planning_ = false;
    ++revision_;
  }
  void print() {
    const std::lock_guard lock{mutex_};
    state_ = JobState::Printing;
    ++revision_;
  }
  std::atomic<bool> can_plan{true};
  /// The list that was planned last.
  [[nodiscard]] json asked() {
    const std::lock_guard lock{mutex_};
    return hand_;
  }

 private:
  std::mutex mutex_;
  json hand_ = json::parse(R"({"extra":[],"forbidden":[],"removed":[]})");
  std::string message_;
  JobState state_ = JobState::AwaitingApproval;
  bool is_planning_ = false;
  std::atomic<std::uint64_t> revision_{1};
};

class SupportsPage : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::Browser::is_installed()) GTEST_SKIP() << "no chromium and chromedriver on this machine";
    browser = std::make_unique<test::Browser>();
    browser->open(fmt::format("http://127.0.0.1:{}/", server->port()));
    ASSERT_TRUE(browser->becomes_true("return document.querySelector('#job-name').textContent === 'plate.ply';"));
    browser->click("#supports-box > summary");
    ASSERT_TRUE(says("#pin-count", "1 pin,"));
    show_layer(4);
    browser->run("document.querySelector('#contours').scrollIntoView({block: 'center'});");
  }
  [[nodiscard]] bool says(const std::string& css, const std::string& text) const {
    return browser->becomes_true(
        fmt::format("return document.querySelector('{}').textContent.includes('{}');", css, text));
  }
  void show_layer(int layer) {
    browser->run(fmt::format(
        "const s = document.querySelector('#layer'); s.value = {}; s.dispatchEvent(new Event('input'));", layer));
    ASSERT_TRUE(browser->becomes_true(fmt::format("return site.view && site.view.layer.layer === {};", layer)));
  }
  /// Pixels of the window where the page draws that place.
  [[nodiscard]] std::array<int, 2> pixel_of(double x_mm, double y_mm) const {
    const json at = browser->run(fmt::format(
        "const c = document.querySelector('#contours'), b = c.getBoundingClientRect(), p = [{}, {}];"
        "return [b.left + site.view.x(p) * b.width / c.width, b.top + site.view.y(p) * b.height / c.height];",
        x_mm, y_mm));
    return {static_cast<int>(std::lround(at[0].get<double>())), static_cast<int>(std::lround(at[1].get<double>()))};
  }
  void plan_again() {
    browser->click("#plan-again");
    if (backend.hand_lists.empty()) {
      ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#token-form').hidden;"));
      browser->type("#token", "secret\n");
      ASSERT_TRUE(browser->becomes_true("return document.querySelector('#token-form').hidden;"));
      browser->click("#plan-again");
    }
    ASSERT_TRUE(says("#job-line", "planning"));
    EXPECT_TRUE(
        browser->becomes_true("return !document.querySelector('#planning').hidden && "
                              "document.querySelector('#planning-progress').value === 0.4;"));
    backend.finish_planning();
    ASSERT_TRUE(says("#supports-answer", backend.can_plan ? "Planned:" : "No plan was made"));
  }

  PlateBackend backend;
  SystemClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  FabWeb site{backend, sign_in, {.version = "0", .three_js = ""}};
  std::unique_ptr<WebServer> server = WebServer::listen({"127.0.0.1"}, site, "telefab-fab/0", clock).value();
  std::unique_ptr<test::Browser> browser;
};

TEST_F(SupportsPage, AddsAPinByAClickAndShowsWhatThatChanged) {
  browser->click_at(pixel_of(18, 20));
  ASSERT_TRUE(says("#changes", "add a pin at"));
  test::keep_screenshot(*browser, "page-supports");
  plan_again();
  const json asked = backend.asked();
  ASSERT_THAT(asked["extra"], SizeIs(1)) << asked;
  EXPECT_NEAR(asked["extra"][0]["x_mm"].get<double>(), 18, 0.1);
  EXPECT_NEAR(asked["extra"][0]["y_mm"].get<double>(), 20, 0.1);
  // Above the middle of the part's layer 2, and not above that of layer 3, which is print layer 4.
  EXPECT_GT(asked["extra"][0]["z_mm"].get<double>(), 2.5 * 0.2);
  EXPECT_LE(asked["extra"][0]["z_mm"].get<double>(), 3.5 * 0.2);
  EXPECT_TRUE(says("#differences", "held: layer 4 bears too much \u2192 passed: it carries"));
  EXPECT_TRUE(says("#pin-count", "2 pins, 2 of them"));
  EXPECT_EQ(browser->run("return document.querySelector('#layer').value;"), "4") << "the layer looked at is kept";
  EXPECT_EQ(browser->run("return document.querySelector('#changes').children.length;"), 0);
  test::keep_screenshot(*browser, "page-supports-planned");
}

TEST_F(SupportsPage, DeletesThePlannersPinAndTakesTheDeletionOfAPinByHandBack) {
  browser->click_at(pixel_of(26, 20));
  ASSERT_TRUE(says("#supports-answer", "medium tip"));
  browser->press({"\xEE\x80\x97"});  // Delete
  ASSERT_TRUE(says("#changes", "remove the pin at (26.00, 20.00)"));
  plan_again();
  EXPECT_EQ(backend.asked(),
            json::parse(R"({"extra":[],"forbidden":[],"removed":[{"x_mm":26,"y_mm":20,"part_layer":3}]})"));
  EXPECT_TRUE(says("#pin-count", "0 pins"));
  browser->click_at(pixel_of(18, 20));
  ASSERT_TRUE(says("#changes", "add a pin"));
  plan_again();
  browser->click_at(pixel_of(18, 20));
  browser->click("#remove-pin");
  ASSERT_TRUE(says("#changes", "remove the pin"));
  browser->click("#undo");
  ASSERT_TRUE(says("#supports-answer", "Taken back"));
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#plan-again').disabled;"));
  browser->click_at(pixel_of(18, 20));
  browser->click("#remove-pin");
  plan_again();
  EXPECT_THAT(backend.asked()["extra"], SizeIs(0)) << "a pin by hand is no longer asked for";
  EXPECT_THAT(backend.asked()["removed"], SizeIs(1));
}

TEST_F(SupportsPage, MovesAPinThatIsDraggedAndKeepsAPlaceFree) {
  browser->drag(pixel_of(26, 20), pixel_of(22, 12));
  ASSERT_TRUE(says("#changes", "move the pin at (26.00, 20.00) mm to (2"));
  browser->run("document.querySelector('#tool').value = 'keep';");
  browser->click_at(pixel_of(16, 22));
  ASSERT_TRUE(says("#changes", "keep 2 mm around"));
  plan_again();
  const json asked = backend.asked();
  ASSERT_THAT(asked["extra"], SizeIs(1)) << asked;
  EXPECT_NEAR(asked["extra"][0]["x_mm"].get<double>(), 22, 0.1);
  ASSERT_THAT(asked["removed"], SizeIs(1));
  ASSERT_THAT(asked["forbidden"], SizeIs(1));
  EXPECT_EQ(asked["forbidden"][0]["radius_mm"], 2);
  EXPECT_EQ(asked["forbidden"][0]["from_z_mm"], 0);
}

TEST_F(SupportsPage, AddsNoPinBesideThePartOrInsideIt) {
  browser->click_at(pixel_of(31, 26));
  EXPECT_TRUE(says("#supports-answer", "no part here"));
  show_layer(6);
  browser->click_at(pixel_of(18, 20));
  EXPECT_TRUE(says("#supports-answer", "goes on below"));
  show_layer(0);
  browser->click_at(pixel_of(12, 7));
  EXPECT_TRUE(says("#supports-answer", "below the part"));
  EXPECT_EQ(browser->run("return document.querySelector('#changes').children.length;"), 0);
}

TEST_F(SupportsPage, IsUsedByKeyboardAlone) {
  const std::string enter = "\xEE\x80\x87", del = "\xEE\x80\x97", right = "\xEE\x80\x94", left = "\xEE\x80\x92";
  browser->run("document.querySelector('#contours').focus();");
  browser->press({"n"});
  ASSERT_TRUE(says("#supports-answer", "Pin at (26.00, 20.00)"));
  browser->press({del});
  ASSERT_TRUE(says("#changes", "remove the pin"));
  browser->press({left, left, enter});
  ASSERT_TRUE(says("#changes", "add a pin"));
  browser->press({right, del});
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#changes').children.length === 1;"));
}

TEST_F(SupportsPage, TellsThatThePlanOfBeforeStandsWhereNoOtherCouldBeMade) {
  backend.can_plan = false;
  browser->click_at(pixel_of(18, 20));
  ASSERT_TRUE(says("#changes", "add a pin"));
  plan_again();
  EXPECT_TRUE(says("#supports-answer", "too tall"));
  EXPECT_TRUE(says("#pin-count", "1 pin,"));
  EXPECT_EQ(browser->run("return document.querySelector('#differences').children.length;"), 0);
}

TEST_F(SupportsPage, ChangesNothingWhileThePlanIsMade) {
  browser->click_at(pixel_of(18, 20));
  ASSERT_TRUE(says("#changes", "add a pin"));
  (void)backend.plan_again("job-1", "{\"extra\":[],\"forbidden\":[],\"removed\":[]}", "ben");
  ASSERT_TRUE(says("#job-line", "planning"));
  EXPECT_TRUE(browser->becomes_true(
      "return document.querySelector('#undo').disabled && document.querySelector('#plan-again').disabled;"));
  browser->click_at(pixel_of(22, 12));
  EXPECT_EQ(browser->run("return document.querySelector('#changes').children.length;"), 1);
}

TEST_F(SupportsPage, PlansNothingAgainThatIsPrinted) {
  browser->click_at(pixel_of(18, 20));
  ASSERT_TRUE(browser->becomes_true("return !document.querySelector('#plan-again').disabled;"));
  backend.print();
  ASSERT_TRUE(says("#job-line", "printing"));
  EXPECT_TRUE(browser->becomes_true("return document.querySelector('#plan-again').disabled;"));
}

TEST_F(SupportsPage, EveryControlHasANameAndThePageFitsAPhone) {
  EXPECT_EQ(
      browser->run("return [...document.querySelectorAll('#supports-box button, #supports-box input, #supports-box "
                   "select, #supports-box progress, #changes, #differences')].filter((e) => "
                   "!(e.getAttribute('aria-label') || (e.labels && e.labels.length) || e.textContent.trim())).length;"),
      0);
  browser->resize(500, 900);
  EXPECT_TRUE(browser->becomes_true("return document.documentElement.scrollWidth <= window.innerWidth;"));
  browser->run("document.querySelector('#contours').scrollIntoView({block: 'start'});");
  browser->click_at(pixel_of(18, 20));
  ASSERT_TRUE(says("#changes", "add a pin"));
  test::keep_screenshot(*browser, "page-supports-phone");
}

}  // namespace
}  // namespace telefab::fab
