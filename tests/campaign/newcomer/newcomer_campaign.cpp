// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <fstream>
#include <telefab/base/clock.hpp>

#include "../../integration/page/screenshot.hpp"

// What somebody does who has installed Telefab and has a scan: drops it on the scan site's page, sends it, lets it
// print at the fab's page, and sees it done.
//   campaign_newcomer SCAN_PAGE SCAN_TOKEN FAB_PAGE FAB_TOKEN SCAN PICTURES
namespace {

using namespace telefab;
using namespace telefab::test;

class Walk {
 public:
  /// Ends the walk where it does not become true in a few minutes; else says how long it took.
  void until(const std::string& what, const std::string& body) {
    for (int tens = 0; tens < 30; ++tens)
      if (browser.becomes_true(body)) {
        const double at_s = std::chrono::duration<double>(clock_.now() - began_).count();
        fmt::print("  {:6.1f} s  {:5.1f} s  {}\n", at_s, at_s - std::exchange(last_s_, at_s), what);
        std::fflush(stdout);
        return;
      }
    throw std::runtime_error(what + ": " + browser.run("return document.body.innerText;").get<std::string>());
  }
  void sign_in(const std::string& token) {
    until("asked for the token", "return !document.querySelector('#token-form').hidden;");
    browser.type("#token", token + "\n");
  }

  Browser browser;

 private:
  SystemClock clock_;
  Nanoseconds began_ = clock_.now();
  double last_s_ = 0;
};

void walk(const std::vector<std::string>& words) {
  Walk way;
  Browser& browser = way.browser;
  browser.open(words[0]);
  way.until("the scan site's page", "return document.querySelector('#link').textContent === 'live';");
  browser.type("#scan-file", words[4]);
  way.sign_in(words[1]);
  way.until("the scan in 3-D", "return place.view?.reading.state === 'done' && (place.view.picture.points ?? 0) > 0;");
  way.until("in its colours", "return place.view?.look.state === 'done';");
  browser.run(
      "byId('size-by').value = 'height'; byId('size-value').value = '30'; "
      "byId('size-by').dispatchEvent(new Event('input', { bubbles: true }));");
  browser.click("#find-way");
  way.until("the best way to stand", "return document.querySelectorAll('#ways li').length > 0;");
  way.until("what it takes",
            "return place.view.estimate.state === 'done' && place.view.estimate.asked.includes('rotate') && "
            "!byId('send').disabled;");
  keep_screenshot(browser, "newcomer-place");
  browser.click("#send");
  way.until("sent", "return !document.querySelector('#job').hidden && state.jobs.length === 1;");
  way.until("cut", "return state.jobs[0].layers > 0 && state.jobs[0].layers_sliced === state.jobs[0].layers;");
  way.until("planned", "return ['awaiting-approval', 'ready', 'printing', 'done'].includes(state.jobs[0].state);");
  const bool is_held = browser.run("return state.jobs[0].state === 'awaiting-approval';").get<bool>();
  browser.open(words[2]);
  way.until("the fab's page",
            "return state.jobs.length === 1 && document.querySelector('#job-name').textContent !== '';");
  if (is_held) {
    browser.click("[data-action=approve]");
    way.sign_in(words[3]);
    way.until("asked what is let through",
              "return document.querySelector('#approval').open || "
              "document.querySelector('#answer').textContent.includes('accepted');");
    browser.run("for (const box of document.querySelectorAll('#approval input')) box.click();");
    if (browser.run("return document.querySelector('#approval').open;").get<bool>()) browser.click("#approval-go");
  }
  way.until("printed", "return state.jobs[0].state === 'done';");
  keep_screenshot(browser, "newcomer-done");
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words{argv + 1, argv + argc};
  if (words.size() != 6) {
    fmt::print(stderr, "campaign_newcomer SCAN_PAGE SCAN_TOKEN FAB_PAGE FAB_TOKEN SCAN PICTURES\n");
    return 2;
  }
  ::setenv("TELEFAB_SCREENSHOTS", words[5].c_str(), 1);
  try {
    walk(words);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 1;
  }
  return 0;
}
