// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <fstream>

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

/// Drawn: the slider's layer is in the canvas and its mask is decoded.
constexpr const char* kIsDrawn =
    "typeof state !== 'undefined' && state.drawn === `${state.chosen}/${document.querySelector('#layer').value}` && "
    "document.querySelector('#mask').complete && document.querySelector('#mask').naturalWidth > 0";

}  // namespace

PageFigures look_at_page(std::uint16_t port, std::uint32_t layers) {
  Browser browser;
  // A first visit fills the browser's own start; the second is measured, with nothing kept of the page.
  browser.open(fmt::format("http://127.0.0.1:{}/v1/version", port));
  browser.open(fmt::format("http://127.0.0.1:{}/", port));
  (void)browser.becomes_true("return " + std::string{kIsDrawn} + ";");
  PageFigures figures;
  figures.job_drawn_ms = browser.run("return state.drawnAt;").get<double>();
  (void)browser.becomes_true("return performance.getEntriesByName('first-contentful-paint').length > 0;");
  figures.first_paint_ms =
      browser.run("return performance.getEntriesByName('first-contentful-paint')[0].startTime;").get<double>();
  constexpr std::uint32_t kJumps = 40;
  double sum = 0;
  std::vector<double> all;
  for (std::uint32_t i = 0; i < kJumps; ++i) {
    const std::uint32_t layer = (i * 193 + 17) % layers;  // all over the part, no layer twice in a row
    const double taken =
        browser
            .run_async(
                fmt::format("const done = arguments[0], slider = document.querySelector('#layer'), began = "
                            "performance.now(); slider.value = {}; slider.dispatchEvent(new Event('input')); const "
                            "look = () => {} ? done(performance.now() - began) : requestAnimationFrame(look); look();",
                            layer, kIsDrawn))
            .get<double>();
    sum += taken;
    all.push_back(taken);
  }
  std::sort(all.begin(), all.end());
  figures.scrub_worst_ms = all.back();
  figures.scrub_p95_ms = all[kJumps * 95 / 100];
  figures.scrub_mean_ms = sum / kJumps;
  figures.script_mb = browser.run("return performance.memory.usedJSHeapSize;").get<double>() / 1e6;
  figures.process_mb = renderer_mb(browser.profile());
  return figures;
}

void take_pictures(std::uint16_t port, const std::filesystem::path& folder) {
  Browser browser;
  ::setenv("TELEFAB_SCREENSHOTS", folder.c_str(), 1);
  browser.open(fmt::format("http://127.0.0.1:{}/", port));
  for (const auto& [name, width, height] : {std::tuple{"page-wide", 1200, 1700}, std::tuple{"page-phone", 500, 1900}}) {
    browser.resize(width, height);
    (void)browser.becomes_true("return " + std::string{kIsDrawn} + ";");
    keep_screenshot(browser, name);
  }
}

}  // namespace telefab::test
