// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <numeric>
#include <random>
#include <thread>

#include "../../integration/page/screenshot.hpp"
#include "web_fab.hpp"

namespace telefab::test {
namespace {

/// Proportional set size of the largest renderer among the processes with this profile folder, megabytes.
double renderer_mb(const std::string& profile) {
  double most = 0;
  for (const auto& entry : std::filesystem::directory_iterator{"/proc"}) {
    std::string command;
    std::getline(std::ifstream{entry.path() / "cmdline", std::ios::binary}, command, '\n');
    if (command.find(profile) == std::string::npos || command.find("--type=renderer") == std::string::npos) continue;
    std::ifstream map{entry.path() / "smaps_rollup"};
    for (std::string word; map >> word;)
      if (word == "Pss:") {
        double kilobytes = 0;
        map >> kilobytes;
        most = std::max(most, kilobytes / 1e3);
      }
  }
  return most;
}

/// What is looked at on a site's page.
struct Scrubbed {
  const char* slider;
  const char* is_drawn;  ///< the slider's layer is in the canvas, and its mask is decoded
};
constexpr Scrubbed kFabPage{
    "#layer",
    "typeof state !== 'undefined' && state.drawn === `${state.chosen}/${document.querySelector('#layer').value}` && "
    "document.querySelector('#mask').complete && document.querySelector('#mask').naturalWidth > 0"};
constexpr Scrubbed kScanPage{"#cut-layer",
                             "typeof cutLayers !== 'undefined' && cutLayers.drawn === "
                             "`${state.chosen}/${document.querySelector('#cut-layer').value}`"};

constexpr std::uint32_t kJumps = 200;

/// Jumps of the slider to layers all over the part, until each is drawn: the answers of the site, the script, and the
/// frame.
ScrubFigures scrub(Browser& browser, const Scrubbed& page) {
  const auto layers = browser.run(fmt::format("return Number(document.querySelector('{}').max) + 1;", page.slider))
                          .get<std::uint32_t>();
  std::mt19937 random{22};
  const auto jump = [&] {
    return browser
        .run_async(fmt::format("const done = arguments[0], slider = document.querySelector('{}'), began = "
                               "performance.now(); slider.value = {}; slider.dispatchEvent(new Event('input')); "
                               "const look = () => {} ? done(performance.now() - began) : "
                               "requestAnimationFrame(look); look();",
                               page.slider, random() % layers, page.is_drawn))
        .get<double>();
  };
  // While the page is still being set up; nobody has seen it yet.
  const double first_ms = jump();
  std::this_thread::sleep_for(std::chrono::seconds{1});
  std::vector<double> taken;
  for (std::uint32_t i = 0; i < kJumps; ++i) taken.push_back(jump());
  std::sort(taken.begin(), taken.end());
  return {layers, first_ms, std::accumulate(taken.begin(), taken.end(), 0.0) / kJumps, taken[kJumps * 95 / 100],
          taken.back()};
}

double first_paint_ms(Browser& browser) {
  (void)browser.becomes_true("return performance.getEntriesByName('first-contentful-paint').length > 0;");
  return browser.run("return performance.getEntriesByName('first-contentful-paint')[0].startTime;").get<double>();
}

}  // namespace

PageFigures look_at_page(std::uint16_t port) {
  Browser browser;
  // A first visit fills the browser's own start; the second is measured, with nothing kept of the page.
  browser.open(fmt::format("http://127.0.0.1:{}/v1/version", port));
  browser.open(fmt::format("http://127.0.0.1:{}/", port));
  const bool is_fab = browser.run("return document.querySelector('#layer') !== null;").get<bool>();
  const Scrubbed& page = is_fab ? kFabPage : kScanPage;
  if (!browser.becomes_true(fmt::format("return {};", page.is_drawn)))
    throw std::runtime_error{"the page shows no layer of a job"};
  PageFigures figures;
  figures.job_drawn_ms = browser.run(is_fab ? "return state.drawnAt;" : "return cutLayers.drawnAt;").get<double>();
  figures.first_paint_ms = first_paint_ms(browser);
  figures.scrub = scrub(browser, page);
  figures.script_mb = browser.run("return performance.memory.usedJSHeapSize;").get<double>() / 1e6;
  figures.process_mb = renderer_mb(browser.profile());
  return figures;
}

std::string sentence_of(const PageFigures& figures) {
  const ScrubFigures& scrub = figures.scrub;
  return fmt::format(
      "{} layers: first paint {:.0f} ms, layer drawn {:.0f} ms, scrub to {} layers at random {:.0f} ms "
      "in the mean (95 % within {:.0f}, worst {:.0f}; {:.0f} at once after loading), script {:.1f} MB, page's process "
      "{:.0f} MB",
      scrub.layers, figures.first_paint_ms, figures.job_drawn_ms, kJumps, scrub.mean_ms, scrub.p95_ms, scrub.worst_ms,
      scrub.first_ms, figures.script_mb, figures.process_mb);
}

void take_pictures(std::uint16_t port, const std::filesystem::path& folder) {
  Browser browser;
  ::setenv("TELEFAB_SCREENSHOTS", folder.c_str(), 1);
  browser.open(fmt::format("http://127.0.0.1:{}/", port));
  for (const auto& [name, width, height] : {std::tuple{"page-wide", 1200, 1700}, std::tuple{"page-phone", 500, 1900}}) {
    browser.resize(width, height);
    (void)browser.becomes_true(fmt::format("return {};", kFabPage.is_drawn));
    keep_screenshot(browser, name);
  }
}

}  // namespace telefab::test
