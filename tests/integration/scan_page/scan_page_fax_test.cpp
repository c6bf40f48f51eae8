// SPDX-License-Identifier: GPL-3.0-or-later
#include "../page/accessible.hpp"
#include "../page/screenshot.hpp"
#include "scan_page_site.hpp"

namespace telefab::test {
namespace {

constexpr const char* kTab = "\uE004";
constexpr const char* kEnter = "\uE007";
constexpr const char* kDown = "\uE015";

class ScanPageFax : public ScanPageSite {
 protected:
  void SetUp() override {
    if (!Browser::is_installed()) GTEST_SKIP() << "no chromium and chromedriver on this machine";
    set_machine(40);
    start_with_page();
    browser = std::make_unique<Browser>();
    browser->open(fmt::format("http://127.0.0.1:{}/", web_port()));
    ASSERT_TRUE(browser->becomes_true("return document.querySelector('#link').textContent === 'live';"));
  }
  /// By the Tab key alone, and to where a ring shows it.
  void tab_to(const std::string& css) {
    for (int presses = 0; presses < 120; ++presses) {
      if (browser->run("return document.activeElement.matches('" + css + "');").get<bool>()) {
        EXPECT_TRUE(
            browser
                ->run("const r = document.activeElement.getBoundingClientRect(); return r.bottom > 0 && r.top < "
                      "window.innerHeight;")
                .get<bool>())
            << css << " has the focus and is not to be seen";
        return;
      }
      browser->press({kTab});
    }
    FAIL() << css << " cannot be reached by the Tab key";
  }
  [[nodiscard]] bool becomes(const std::string& body, int tens_of_seconds = 3) {
    for (int k = 0; k < tens_of_seconds; ++k)
      if (browser->becomes_true(body)) return true;
    return false;
  }
  std::unique_ptr<Browser> browser;
};

TEST_F(ScanPageFax, GoesFromAFileToAPrintedPartByTheKeyboardAlone) {
  tab_to("#scan-file");
  browser->type("#scan-file", torus().string());
  ASSERT_TRUE(becomes("return !document.querySelector('#token-form').hidden;"));
  browser->type("#token", token() + "\n");
  ASSERT_TRUE(becomes("return place.view?.look.state === 'done';"));
  keep_screenshot(*browser, "scan-page-place");
  tab_to("#size-by");
  browser->press({kDown});
  tab_to("#size-value");
  browser->press({"4"});
  tab_to("[data-turn=x90]");
  browser->press({kEnter});
  ASSERT_TRUE(becomes("return place.view.estimate.state === 'done' && byId('turn-x').value === '90';"));
  tab_to("[data-turn=reset]");
  browser->press({kEnter});
  ASSERT_TRUE(
      becomes("return place.view.estimate.state === 'done' && byId('estimate').textContent.includes('layers') && "
              "!place.view.estimate.asked.includes('rotate');"));
  tab_to("#find-way");
  browser->press({kEnter});
  ASSERT_TRUE(becomes("return document.querySelectorAll('#ways li').length > 0;"));
  tab_to("[data-turn=reset]");
  browser->press({kEnter});
  tab_to("#send");
  browser->press({kEnter});
  ASSERT_TRUE(becomes("return !document.querySelector('#job').hidden && state.jobs.length === 1;"));
  EXPECT_EQ(browser->run("return state.jobs[0].parameters.height_mm;"), 4);
  ASSERT_TRUE(becomes("return document.querySelector('#cut-text').textContent.includes('ring');"));
  keep_screenshot(*browser, "scan-page-layers");
  ASSERT_TRUE(becomes("return state.jobs[0].state === 'printing';"));
  tab_to("[data-action=pause]");
  browser->press({kEnter});
  ASSERT_TRUE(becomes("return state.jobs[0].state === 'paused';"));
  tab_to("[data-action=resume]");
  browser->press({kEnter});
  ASSERT_TRUE(becomes("return state.jobs[0].state === 'done';", 6));
  EXPECT_EQ(ended(browser->run("return state.jobs[0].id;"))["state"], "done");
}

TEST_F(ScanPageFax, SendsNothingWhileAFieldHoldsNoNumber) {
  browser->run("askToSignIn('');");
  browser->type("#token", token() + "\n");
  browser->type("#scan-file", torus().string());
  ASSERT_TRUE(becomes("return place.view?.look.state === 'done';"));
  browser->run(
      "byId('size-by').value = 'height'; byId('size-by').dispatchEvent(new Event('input', { bubbles: true }));");
  // What the browser takes no value from is not taken for a field that nobody has filled in.
  browser->type("#size-value", "1e");
  EXPECT_TRUE(
      becomes("return byId('send').disabled && byId('send-note').textContent.includes('Height, mm: this is not a "
              "number; write it in decimal digits');"))
      << browser->run("return byId('send-note').textContent;");
  browser->type("#size-value", "0");  // 1e0
  EXPECT_TRUE(becomes("return !byId('send').disabled && byId('send-note').textContent === '';"));
}

TEST_F(ScanPageFax, GoesOnWithAnInterruptedUploadAfterThePageWasLoadedAgain) {
  // Half of it came before.
  const std::string bytes = text_of(torus());
  const auto id = begin("torus.xyz", bytes)["id"].get<std::string>();
  ASSERT_EQ(ask("POST", "/v1/uploads/" + id + "/part?from=0", bytes.substr(0, bytes.size() / 2)).status, 200);
  browser->open(fmt::format("http://127.0.0.1:{}/", web_port()));
  ASSERT_TRUE(becomes("return document.querySelector('#uploads').textContent.includes('interrupted at 50 %');"));
  browser->run("askToSignIn('');");
  browser->type("#token", token() + "\n");
  ASSERT_TRUE(becomes("return state.visitor.may === 'operator';"));
  browser->run(
      "window.parts = []; const before = window.fetch; window.fetch = (path, o) => { if "
      "(String(path).includes('/part')) "
      "parts.push(path); return before(path, o); };");
  browser->type("#scan-file", torus().string());
  ASSERT_TRUE(becomes("return place.view?.reading.state === 'done';"));
  EXPECT_EQ(browser->run("return parts.length;"), 1);
  EXPECT_TRUE(browser->run("return parts[0].endsWith('from=" + std::to_string(bytes.size() / 2) + "');").get<bool>());
}

TEST_F(ScanPageFax, HashesWithoutTheBrowsersHelpAsWithIt) {
  EXPECT_EQ(browser->run_async(
                "const done = arguments[0]; (async () => { for (const n of [0, 1, 55, 56, 63, 64, 65, 119, 120, "
                "1000, 100003]) { const b = new Uint8Array(n).map((_, i) => (i * 7 + n) & 255); const h = new "
                "Sha256(); for (let at = 0; at < n; at += 37) h.feed(b.subarray(at, Math.min(n, at + 37))); const "
                "d = [...new Uint8Array(await crypto.subtle.digest('SHA-256', b))].map((v) => "
                "v.toString(16).padStart(2, '0')).join(''); if (h.hex() !== d) return done(`differs at ${n}`); } "
                "done('same'); })();"),
            "same");
}

TEST_F(ScanPageFax, KeepsToContrastNamesAndTheTabKeyWhileAScanIsPlaced) {
  browser->run("askToSignIn('');");
  browser->type("#token", token() + "\n");
  browser->type("#scan-file", torus().string());
  ASSERT_TRUE(becomes("return place.view?.estimate.state === 'done';"));
  browser->run(
      "for (const each of document.querySelectorAll('details')) each.open = true; byId('crop-on').click(); "
      "byId('size-by').value = 'height'; byId('size-by').dispatchEvent(new Event('input', { bubbles: true }));");
  browser->click("#find-way");
  ASSERT_TRUE(becomes("return document.querySelectorAll('#ways li').length > 0;"));
  for (const char* scheme : {"light", "dark"}) {
    browser->prefer_colours(scheme);
    EXPECT_EQ(texts_without_contrast(*browser), "[]") << scheme;
    keep_screenshot(*browser, std::string{"scan-page-place-"} + scheme);
  }
  EXPECT_EQ(faults_for_screen_readers(*browser), "[]");
  EXPECT_EQ(out_of_reach_of_tab(*browser), "[]");
}

TEST_F(ScanPageFax, FitsAPhoneAndAsksNobodyButItsOwnSite) {
  browser->run("askToSignIn('');");
  browser->type("#token", token() + "\n");
  browser->type("#scan-file", torus().string());
  ASSERT_TRUE(becomes("return place.view?.estimate.state === 'done' || place.view?.estimate.state === 'failed';"));
  browser->resize(500, 900);  // the narrowest window of the desktop browser
  EXPECT_TRUE(becomes("return document.documentElement.scrollWidth <= window.innerWidth;"));
  EXPECT_EQ(browser->run("return performance.getEntriesByType('resource').filter((r) => "
                         "!r.name.startsWith(location.origin)).length;"),
            0);
  EXPECT_EQ(faults_for_screen_readers(*browser), "[]");
  keep_screenshot(*browser, "scan-page-place-phone");
}

}  // namespace
}  // namespace telefab::test
