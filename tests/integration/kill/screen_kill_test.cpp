// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <random>
#include <telefab/base/clock.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/test/two_sites.hpp>
#include <utility>

#include "usbfs_host.hpp"

// kill -9 of the unmodified `telefab-fab serve` that shows its masks on a screen, a plain file here, behind the guard
// it started, and has them lit by a GRBL board, the strict model behind a pseudo terminal. The board lives on and
// records what was lit. TELEFAB_KILLS says how many kills (default 4), TELEFAB_SEED when they strike.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

constexpr Nanoseconds kPatience = 30s;
constexpr Nanoseconds kDarkWithin = 250ms;
constexpr double kZTolerance_mm = 1e-3;

class ScreenServeKilled : public test::TwoSites {
 protected:
  void SetUp() override {
    line = std::make_unique<test::PtyHost>(board, mutex);
    screen = folder() / "screen";
    std::ofstream{screen};
    fs::resize_file(screen, 200 * 200 * 4);
    std::ofstream{folder() / "machines" / "toy.toml"} << fmt::format(R"(name = "toy"
description = "A small quick machine: a screen, lit by its stage's board"
[platform]
width_mm = 20.0
depth_mm = 20.0
z_travel_mm = 8.0
[projection]
pixel_pitch_mm = 0.1
irradiance_mw_per_cm2 = 30.0
[layers]
thickness_mm = 0.2
exposure_s = 0.15
bottom_count = 2
bottom_exposure_s = 0.3
[resin]
critical_dose_mj_per_cm2 = 1.5
penetration_mm = 0.3
[motion]
lift_mm = 0.5
lift_speed_mm_per_s = 8.0
lower_speed_mm_per_s = 8.0
settle_s = 0.02
[devices]
projector = "screen"
stage = "grbl"
light = "stage"
allowed_slowdown = 4.0
stage_serial = "{}"
[screen]
connector = "{}"
width_px = 200
height_px = 200
)",
                                                                     line->path(), screen.string());
    start_fab({"--start", "on-approval"});
    start_scan();
    const auto submitted = telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "1"});
    ASSERT_EQ(submitted.code, 0) << submitted.errors;
    job = submitted.output.substr(0, submitted.output.find('\n'));
    const auto watch = telefab_begun({"watch", job});
    ASSERT_NE(watch->wait_for_error_line("approve").find("awaiting-approval"), std::string::npos) << watch->errors();
    kill_scan();
    kill_fab();
    auto store = JobStore::open(folder() / "fab" / "jobs.sqlite", clock);
    ASSERT_TRUE(store) << store.error().what;
    ASSERT_TRUE((*store)->move(job, JobState::Ready, ""));
    store->reset();
    auto journal = PrintJournal::open(std::move(*open_journal_file(job_folder() / "journal")));
    ASSERT_TRUE(journal) << journal.error().what;
    ASSERT_TRUE(journal->write({JournalStep::Approved, {}, clock.wall(), {}, "ana", {}, "although anything: a test"}));
    auto planned = PlannedJob::open(job_folder() / "plan");
    ASSERT_TRUE(planned) << planned.error().what;
    plan = (*planned)->plan();
  }

  [[nodiscard]] fs::path job_folder() const { return folder() / "fab" / "jobs" / job; }
  [[nodiscard]] std::string jobs_output() const { return telefab({"jobs", "--site", fab_site()}).output; }
  [[nodiscard]] bool is_done() const {
    const fs::path record = job_folder() / "report" / "as-built.json";
    return fs::exists(record) && text_of(record).find(R"("outcome": "done")") != std::string::npos;
  }
  [[nodiscard]] bool is_black() const {
    const std::string bytes = text_of(screen);
    return std::all_of(bytes.begin(), bytes.end(), [](char c) { return c == 0; });
  }
  [[nodiscard]] bool is_lit() {
    const std::lock_guard lock{mutex};
    board.tick();
    return board.lamp().lit();
  }
  template <class Condition>
  bool await(Condition condition, Nanoseconds patience = kPatience) {
    for (const Nanoseconds until = clock.now() + patience; clock.now() < until; clock.sleep_for(2ms))
      if (condition()) return true;
    return condition();
  }
  [[nodiscard]] Nanoseconds light_at(double z_mm) {
    const std::lock_guard lock{mutex};
    Nanoseconds sum{};
    for (const LitSpan& lit : log.light())
      if (std::abs(lit.z_mm - z_mm) < kZTolerance_mm) sum += lit.until - lit.from;
    return sum;
  }
  /// The option that decides about a layer that was perhaps exposed, by what the recorder saw.
  [[nodiscard]] std::string decide() {
    auto file = open_journal_file(job_folder() / "journal");
    if (!file) return "ask";
    const auto journal = PrintJournal::open(std::move(*file));
    if (!journal || !journal->resume_point().maybe_exposed) return "ask";
    ++decisions;
    return light_at(plan.layers[journal->resume_point().next.count()].z_mm) > 0ns ? "treat-as-exposed" : "expose-again";
  }

  SystemClock clock;
  MachineLog log;
  std::mutex mutex;
  GrblModel board{8.5, clock, &log};
  std::unique_ptr<test::PtyHost> line;
  fs::path screen;
  std::string job;
  PrintPlan plan;
  int decisions = 0;
};

std::uint64_t number_wanted(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::strtoull(text, nullptr, 10) : otherwise;
}

TEST_F(ScreenServeKilled, LightsEveryLayerForItsTimeHoweverOftenItIsKilled) {
  std::mt19937_64 rng{number_wanted("TELEFAB_SEED", 7)};
  const auto wanted = static_cast<int>(number_wanted("TELEFAB_KILLS", 4));
  int kills = 0, lit_at_death = 0, shown_at_death = 0;
  Nanoseconds slowest{};
  start_fab({"--after-crash", "ask", "--go-on-within-min", "100000"});
  while (kills < wanted && !is_done()) {
    // Every second one in the middle of an exposure.
    const Nanoseconds when = clock.now() + std::chrono::milliseconds{200 + rng() % 2500};
    (void)await([&] { return is_done() || clock.now() >= when; });
    if (kills % 2 == 1) (void)await([&] { return is_done() || is_lit(); });
    if (is_done()) break;
    shown_at_death += is_black() ? 0 : 1;
    lit_at_death += is_lit() ? 1 : 0;
    const Nanoseconds from = clock.now();
    kill_fab();  // SIGKILL
    ++kills;
    EXPECT_TRUE(await([&] { return is_black(); })) << "its mask stays";
    slowest = std::max(slowest, clock.now() - from);
    EXPECT_TRUE(await([&] { return !is_lit(); }, 2s)) << "its light stays on";
    start_fab({"--after-crash", decide(), "--go-on-within-min", "100000"});
  }
  ASSERT_TRUE(await([&] { return is_done(); }, 120s)) << jobs_output() << text_of(job_folder() / "journal");
  EXPECT_LE(slowest, kDarkWithin);
  EXPECT_TRUE(is_black());
  EXPECT_EQ(log.light_while_moving(), 0ns);
  for (const LitSpan& lit : log.light()) EXPECT_LE(lit.until - lit.from, 300ms);
  for (const PlannedLayer& layer : plan.layers)
    EXPECT_EQ(light_at(layer.z_mm), Nanoseconds{layer.exposure}) << "layer " << layer.index.count();
  EXPECT_NE(text_of(job_folder() / "report" / "as-built.json").find("light by the stage's board"), std::string::npos);
  fmt::print(
      "{} kills of telefab-fab serve, {} with its lamp lit, {} with a mask shown, in a print of {} layers: each got "
      "its light once; black within {:.1f} ms; {} decisions\n",
      kills, lit_at_death, shown_at_death, plan.layers.size(), double(slowest.count()) / 1e6, decisions);
}

}  // namespace
}  // namespace telefab::fab
