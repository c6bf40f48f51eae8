// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <telefab/fab/screen/guarded_display.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <telefab/fab/screen/screen_projector.hpp>

#include "guest_pattern.hpp"

// Runs in an emulated computer as its only program: shows patterns on a real kernel's screen, is killed and stopped,
// and tells the test outside, step by step, when to look.
namespace {

using namespace telefab;
using namespace telefab::fab;
using namespace std::chrono_literals;

/// Waits until the test has looked.
void step(const std::string& name) {
  std::printf("\nSTEP %s\n", name.c_str());
  std::fflush(stdout);
  std::string answer;
  std::getline(std::cin, answer);
}

void report(const std::string& what) {
  std::printf("\nREPORT %s\n", what.c_str());
  std::fflush(stdout);
}

[[noreturn]] void give_up(const std::string& why) {
  std::printf("\nFAIL %s\n", why.c_str());
  std::fflush(stdout);
  std::exit(1);
}

std::string behind(const std::string& text, const std::string& mark) {
  const auto at = text.find(mark);
  if (at == std::string::npos) give_up("no " + mark + " in: " + text);
  const auto from = at + mark.size();
  return text.substr(from, text.find('"', from) - from);
}

Result<std::unique_ptr<ScreenProjector>> open_screen(const ScreenSettings& settings, Clock& clock) {
  auto display = open_guarded_display(settings, own_guard_program(), clock);
  if (!display) return tl::unexpected{display.error()};
  const PanelLayout layout{settings.words, settings.packing, {}, {}};
  return ScreenProjector::open(std::move(*display), {panel_pixels(layout), layout, 1}, clock);
}

void show(ScreenProjector& projector, std::uint32_t pattern, Microseconds time) {
  const Mask mask = test::guest_pattern(projector.facts().size, pattern);
  if (const auto ok = projector.load(mask.view(), {time, 1}); !ok) give_up(ok.error().what);
  if (const auto ok = projector.poll(); !ok) give_up(ok.error().what);
  if (const auto ok = projector.expose(); !ok) give_up(ok.error().what);
}

/// A program that shows a pattern until something becomes of it.
pid_t start_worker(const ScreenSettings& settings) {
  int ends[2];
  if (::pipe(ends) != 0) give_up("no pipe");
  const pid_t process = ::fork();
  if (process == 0) {
    SystemClock clock;
    const auto projector = open_screen(settings, clock);
    if (!projector) give_up("worker: " + projector.error().what);
    show(**projector, 1, Microseconds{600s});
    (void)!::write(ends[1], "y", 1);
    while (true) ::pause();
  }
  char word = 0;
  (void)!::read(ends[0], &word, 1);
  ::close(ends[0]);
  ::close(ends[1]);
  return process;
}

pid_t child_of_ours() {
  std::ifstream children{fmt::format("/proc/self/task/{}/children", ::getpid())};
  pid_t child = -1;
  children >> child;
  return child;
}

void set_connection(const std::string& connector, const std::string& word) {
  std::ofstream status{"/sys/class/drm/card0-" + connector + "/status"};
  status << word << std::endl;
  if (!status) give_up("cannot set the connection");
}

/// What the profile would state of this screen; what is not so is refused.
void find_out(ScreenSettings& settings, Clock& clock) {
  const std::string all = describe_screens();
  const std::string mode = fmt::format("{} x {} at ", settings.words.width_px, settings.words.height_px);
  if (all.find(mode) == std::string::npos) give_up("no mode " + mode + " in: " + all);
  settings.refresh_hz = std::atof(all.c_str() + all.find(mode) + mode.size());
  const auto unstated = open_screen(settings, clock);
  if (unstated) give_up("a screen that nobody stated was used");
  settings.edid = behind(unstated.error().what, "screen.edid = \"");
  report("edid " + settings.edid);
  ScreenSettings wrong = settings;
  wrong.edid = "XYZ 0000 0";
  const auto other = open_screen(wrong, clock);
  report("other edid: " + (other ? std::string{"ACCEPTED"} : other.error().what));
  wrong = settings;
  wrong.refresh_hz += 7;
  const auto mode_refused = open_screen(wrong, clock);
  report("other mode: " + (mode_refused ? std::string{"ACCEPTED"} : mode_refused.error().what));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "guard-screen") == 0) return run_screen_guard(kGuardSocket);
  if (argc < 5) give_up("screen_guest CONNECTOR WIDTH HEIGHT PACKING");
  SystemClock clock;
  ScreenSettings settings;
  settings.connector = argv[1];
  settings.words = {static_cast<std::uint32_t>(std::atoi(argv[2])), static_cast<std::uint32_t>(std::atoi(argv[3]))};
  settings.packing = machine_word_from<PixelPacking>(argv[4]).value();
  const bool is_framebuffer = settings.connector.starts_with('/');
  if (!is_framebuffer) find_out(settings, clock);
  {
    const auto projector = open_screen(settings, clock);
    if (!projector) give_up(projector.error().what);
    report("name " + (*projector)->facts().name);
    step("black");
    if (!is_framebuffer) {  // a framebuffer has no owner
      const auto second = open_screen(settings, clock);
      report("second program: " + (second ? std::string{"ACCEPTED"} : second.error().what));
    }
    for (std::uint32_t k = 0; k < 4; ++k) {
      show(**projector, k, Microseconds{600s});
      step(fmt::format("pattern-{}", k));
      if (const auto ok = (*projector)->dark(); !ok) give_up(ok.error().what);
    }
    step("dark");
    show(**projector, 5, Microseconds{300ms});
    clock.sleep_for(600ms);
    step("timed");
    const auto status = (*projector)->poll();
    if (!status || status->state != LightState::Exposed) give_up("the exposure did not end by itself");
  }
  {
    const auto projector = open_screen(settings, clock);
    if (!projector) give_up(projector.error().what);
    show(**projector, 1, Microseconds{600s});
    const pid_t guard = child_of_ours();
    if (guard <= 0) give_up("no guard among the children");
    (void)::kill(guard, SIGKILL);
    clock.sleep_for(50ms);
    if (const auto ok = (*projector)->dark(); !ok) give_up("without its guard: " + ok.error().what);
    step("guard-killed");
    show(**projector, 2, Microseconds{600s});
    step("pattern-2-again");
  }
  for (const auto& [signal, name] : {std::pair{SIGKILL, "killed"}, {SIGSTOP, "stopped"}}) {
    const pid_t worker = start_worker(settings);
    step(fmt::format("before-{}", name));
    (void)::kill(worker, signal);
    clock.sleep_for(600ms);  // emulated, a second is no second; the time itself is tried outside
    step(name);
    (void)::kill(worker, SIGKILL);
    (void)::waitpid(worker, nullptr, 0);
    clock.sleep_for(500ms);
    step(fmt::format("after-{}", name));
  }
  // Last: the emulated cards forget who hangs on them.
  if (!is_framebuffer) {
    const auto projector = open_screen(settings, clock);
    if (!projector) give_up(projector.error().what);
    show(**projector, 1, Microseconds{600s});
    set_connection(settings.connector, "off");  // as if its cable were pulled
    const auto lost = (*projector)->poll();
    if (lost) give_up("a screen that is disconnected is not missed");
    report("disconnected: " + lost.error().what);
    if (const auto ok = (*projector)->dark(); !ok) give_up("disconnected: " + ok.error().what);
    step("disconnected");
  }
  report("END");
  return 0;
}
