// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <linux/sockios.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/stat.h>

#include <cstdlib>
#include <fstream>
#include <random>
#include <telefab/base/clock.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/test/two_sites.hpp>
#include <utility>

#include "usbfs_host.hpp"

// kill -9 of the unmodified `telefab-fab serve`, whose projector and stage are the strict models behind an emulated
// usbfs node and a pseudo terminal. The models live on, as real devices do, and record what was lit. TELEFAB_KILLS says
// how many kills (default 6), TELEFAB_UNPLUGS how many pulled cables (default 2), TELEFAB_SEED when they strike.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

constexpr Nanoseconds kFrame = 16'667us;
constexpr Nanoseconds kPatience = 20s;
constexpr int kRevivals = 4;
constexpr double kZTolerance_mm = 1e-3;

class ServeKilled : public test::TwoSites {
 protected:
  /// What the recorder saw of one print.
  struct Seen {
    std::vector<LitSpan> light;
    std::vector<float> dose;
  };

  void SetUp() override {
    const char* preload = std::getenv("LD_PRELOAD");
    if (preload == nullptr || std::string_view{preload}.find("umockdev") == std::string_view::npos)
      GTEST_SKIP() << "skipped: umockdev is not preloaded; run through ctest";
    host = std::make_unique<test::UsbfsHost>(model, mutex, "T6500");
    line = std::make_unique<test::PtyHost>(board, mutex);
    set_real_machine();
    make_template();
  }

  void set_real_machine() const {
    std::ofstream{folder() / "machines" / "toy.toml"} << fmt::format(R"(name = "toy"
description = "A small quick machine on the device models"
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
peel_mm = 0.2
peel_speed_mm_per_s = 4.0
approach_mm = 0.2
approach_speed_mm_per_s = 4.0
wait_after_exposure_s = 0.03
wait_after_lift_s = 0.03
[devices]
projector = "dlpc900"
stage = "grbl"
led_current = 20
led_polarity = "normal"
allowed_slowdown = 4.0
stage_serial = "{}"
)",
                                                                     line->path());
  }

  /// A fab's folder with one job planned and cleared to print.
  void make_template() {
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
    fs::copy(folder() / "fab", folder() / "template", fs::copy_options::recursive);
    auto planned = PlannedJob::open(job_folder() / "plan");
    ASSERT_TRUE(planned) << planned.error().what;
    plan = (*planned)->plan();
  }

  /// A campaign takes longer than a print may have been left alone.
  void start_site(const std::string& after_crash) {
    start_fab({"--after-crash", after_crash, "--go-on-within-min", "100000"});
  }

  [[nodiscard]] std::string jobs_output() const { return telefab({"jobs", "--site", fab_site()}).output; }
  [[nodiscard]] fs::path job_folder() const { return folder() / "fab" / "jobs" / job; }
  [[nodiscard]] bool is_printed() const { return fs::exists(job_folder() / "report" / "as-built.json"); }

  /// Printed to its end; a record is kept of a print that faulted too.
  [[nodiscard]] bool is_done() const {
    return is_printed() &&
           text_of(job_folder() / "report" / "as-built.json").find(R"("outcome": "done")") != std::string::npos;
  }

  [[nodiscard]] test::Outcome verify_as_built() const {
    return test::run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab-fab", "verify",
                      (job_folder() / "plan").string(), "--machines", (folder() / "machines").string(), "--as-built",
                      (job_folder() / "report" / "as-built.json").string()});
  }

  template <class Condition>
  bool await(Condition condition) {
    for (const Nanoseconds until = clock.now() + kPatience; clock.now() < until; clock.sleep_for(2ms))
      if (condition()) return true;
    return condition();
  }

  [[nodiscard]] std::uint64_t transfers() {
    const std::lock_guard lock{mutex};
    return model.transfers();
  }
  void wait_for_dark() {
    EXPECT_TRUE(await([&] {
      const std::lock_guard lock{mutex};
      model.tick();
      board.tick();
      return !model.lit();
    }));
  }

  /// Open descriptors of the fab.
  [[nodiscard]] std::ptrdiff_t descriptors() {
    return std::distance(fs::directory_iterator{fmt::format("/proc/{}/fd", fab().id())}, fs::directory_iterator{});
  }
  /// What the fab uses of a processor during two seconds.
  [[nodiscard]] double processor_share() {
    const auto used_ns = [&] {
      double sum = 0;
      for (const auto& task : fs::directory_iterator{fmt::format("/proc/{}/task", fab().id())})
        sum += std::strtod(text_of(task.path() / "schedstat").c_str(), nullptr);
      return sum;
    };
    const Nanoseconds from = clock.now();
    const double before = used_ns();
    clock.sleep_for(2s);
    return (used_ns() - before) / double((clock.now() - from).count());
  }

  /// The part without any injected fault; leaves the sealed record in place.
  Seen reference_part() {
    begin_part();
    start_site("ask");
    EXPECT_TRUE(await([&] { return is_printed(); })) << "never printed";
    return seen();
  }

  void begin_part() {
    if (std::exchange(has_begun, true)) {
      fab().send_signal(SIGTERM);
      EXPECT_EQ(fab().finish(), 0);
    }
    kill_fab();
    fs::remove_all(folder() / "fab");
    fs::copy(folder() / "template", folder() / "fab", fs::copy_options::recursive);
    wait_for_dark();
    const std::lock_guard lock{mutex};
    model.forget_dose();
    seen_before = log.light().size();
  }
  [[nodiscard]] Seen seen() {
    const std::lock_guard lock{mutex};
    auto light = log.light();
    light.erase(light.begin(), light.begin() + static_cast<std::ptrdiff_t>(seen_before));
    return {std::move(light), model.dose_s()};
  }
  [[nodiscard]] Nanoseconds light_at(double z_mm) {
    Nanoseconds sum{};
    for (const LitSpan& lit : seen().light)
      if (std::abs(lit.z_mm - z_mm) < kZTolerance_mm) sum += lit.until - lit.from;
    return sum;
  }

  /// The option that decides about a layer that was perhaps exposed, by what the recorder saw; "ask" where there is
  /// none.
  [[nodiscard]] std::string decide() {
    auto file = open_journal_file(job_folder() / "journal");
    if (!file) return "ask";
    const auto journal = PrintJournal::open(std::move(*file));
    if (!journal || !journal->resume_point().maybe_exposed) return "ask";
    ++decisions;
    const PlannedLayer& layer = plan.layers[journal->resume_point().next.count()];
    return light_at(layer.z_mm) > 0ns ? "treat-as-exposed" : "expose-again";
  }

  void expect_same_part(const Seen& now, const Seen& reference) {
    ASSERT_EQ(now.light.size(), reference.light.size());
    for (std::size_t k = 0; k < now.light.size(); ++k) {
      EXPECT_EQ(now.light[k].mask, reference.light[k].mask) << k;
      EXPECT_EQ((now.light[k].until - now.light[k].from).count(),
                (reference.light[k].until - reference.light[k].from).count())
          << k;
      EXPECT_NEAR(now.light[k].z_mm, reference.light[k].z_mm, kZTolerance_mm) << k;
    }
    EXPECT_TRUE(now.dose == reference.dose) << "the dose of some mirror differs";
  }

  SystemClock clock;
  MachineLog log;
  std::mutex mutex;
  Dlpc900Model model{1, 6, clock, &log};
  GrblModel board{8.5, clock, &log};
  std::unique_ptr<test::UsbfsHost> host;
  std::unique_ptr<test::PtyHost> line;
  std::string job;
  PrintPlan plan;
  std::size_t seen_before = 0;
  bool has_begun = false;
  int decisions = 0;
};

/// Nothing waits to be read on any socket of this process, at either end. umockdev loses its place when a client dies
/// within an emulated ioctl, so the kills strike between two of them; an exposure, a move or a transfer may be under
/// way.
bool is_quiet() {
  for (const auto& entry : fs::directory_iterator{"/proc/self/fd"}) {
    const int fd = std::atoi(entry.path().filename().c_str());
    struct stat about {};
    if (::fstat(fd, &about) != 0 || !S_ISSOCK(about.st_mode)) continue;
    int unread = 0, unsent = 0;
    if (::ioctl(fd, SIOCINQ, &unread) == 0 && unread > 0) return false;
    if (::ioctl(fd, SIOCOUTQ, &unsent) == 0 && unsent > 0) return false;
  }
  return true;
}

std::uint64_t seed_wanted() {
  const char* text = std::getenv("TELEFAB_SEED");
  return text != nullptr ? std::strtoull(text, nullptr, 10) : 7;
}

int kills_wanted() {
  const char* text = std::getenv("TELEFAB_KILLS");
  return text != nullptr ? std::max(1, std::atoi(text)) : 6;
}

TEST_F(ServeKilled, PrintsTheSamePartHoweverOftenItIsKilled) {
  begin_part();
  const std::uint64_t transfers_before = transfers();
  const Nanoseconds from = clock.now();
  start_site("ask");
  ASSERT_TRUE(await([&] { return is_printed(); })) << "never printed";
  const Nanoseconds whole = clock.now() - from;
  const std::uint64_t in_all = transfers() - transfers_before;
  const Seen reference = seen();
  ASSERT_GT(reference.light.size(), 4u);
  const test::Outcome sound = verify_as_built();
  EXPECT_EQ(sound.code, 0) << sound.output << sound.errors;
  for (const char* key : {"contours_sha256", "part_sha256", "profile_sha256", "scan_site_key", "software"})
    EXPECT_NE(sound.output.find(key), std::string::npos) << key;
  std::ofstream{job_folder() / "plan" / "supports.json", std::ios::app} << '\n';
  const test::Outcome changed = verify_as_built();
  EXPECT_NE(changed.code, 0);
  EXPECT_NE(changed.output.find("the supports of the plan folder"), std::string::npos) << changed.output;

  int kills = 0, parts = 0, stalls = 0;
  std::mt19937_64 rng{seed_wanted()};
  for (const int wanted = kills_wanted(); kills < wanted; ++parts) {
    SCOPED_TRACE(fmt::format("part {}", parts));
    begin_part();
    start_site("ask");
    for (int deaths = 1 + static_cast<int>(rng() % 3); deaths > 0 && kills < wanted; --deaths) {
      // Half of them by what has gone over the bus, half by time.
      const bool by_bus = rng() % 2 == 0;
      const std::uint64_t bus = transfers() + 1 + rng() % std::max<std::uint64_t>(1, in_all * 2 / 3);
      const Nanoseconds time = clock.now() + Nanoseconds{static_cast<std::int64_t>(rng() % (whole.count() * 2u / 3u))};
      const bool ran = await([&] { return is_printed() || (by_bus ? transfers() >= bus : clock.now() >= time); });
      if (!ran) ++stalls;
      if (is_printed()) break;
      ASSERT_TRUE(await([&] {
        fab().send_signal(SIGSTOP);
        clock.sleep_for(2ms);
        if (is_quiet()) return true;
        fab().send_signal(SIGCONT);
        return false;
      }));
      kill_fab();  // SIGKILL
      ++kills;
      wait_for_dark();  // the controller ends a running exposure itself; a service starts again after two seconds
      start_site(decide());
    }
    // umockdev sometimes loses an answer on a busy computer. What the watchdog would do then is one more kill; a print
    // that had faulted by then waits for an operator.
    for (int revivals = 0; !await([&] { return is_printed(); }) && revivals < kRevivals; ++revivals) {
      ++stalls;
      ++kills;
      kill_fab();
      wait_for_dark();
      start_site(decide());
      (void)telefab({"resume", job, "--site", fab_site()});
    }
    ASSERT_TRUE(is_printed()) << "never finished: " << jobs_output() << text_of(job_folder() / "journal");
    expect_same_part(seen(), reference);
    const auto sealed = text_of(job_folder() / "report" / "as-built.json");
    const auto record = unseal(sealed, {});
    ASSERT_TRUE(record) << record.error().what;
    EXPECT_EQ(record->record.layers.size(), plan.layers.size());
    EXPECT_NE(record->signed_by, "");
    if (HasFailure()) break;
  }
  EXPECT_EQ(log.light_while_moving(), 0ns);
  for (const LitSpan& lit : log.light()) EXPECT_LE(lit.until - lit.from, 300ms + kFrame);
  EXPECT_EQ(model.endless_orders(), 0u);
  fmt::print(
      "{} kills of telefab-fab serve in {} prints of {} layers ({} lit): every part got the same light; {} explicit "
      "decisions; {} waits ended by a stall of the emulation; one print {:.1f} s, {} transfers\n",
      kills, parts, plan.layers.size(), reference.light.size(), decisions, stalls, double(whole.count()) * 1e-9,
      in_all);
}

int unplugs_wanted() {
  const char* text = std::getenv("TELEFAB_UNPLUGS");
  return text != nullptr ? std::max(1, std::atoi(text)) : 2;
}

TEST_F(ServeKilled, PrintsTheSamePartHoweverOftenItsProjectorIsUnplugged) {
  const Nanoseconds from = clock.now();
  const Seen reference = reference_part();
  const Nanoseconds whole = clock.now() - from;
  ASSERT_GT(reference.light.size(), 4u);
  const auto is_paused = [&] { return jobs_output().find("paused") != std::string::npos; };

  int unplugs = 0, parts = 0, unknown = 0, resumes = 0;
  std::ptrdiff_t before = 0, most = 0;
  double idle_share = 0;
  std::mt19937_64 rng{seed_wanted()};
  for (const int wanted = unplugs_wanted(); unplugs < wanted; ++parts) {
    SCOPED_TRACE(fmt::format("part {}", parts));
    begin_part();
    start_site("ask");
    before = 0;
    while (unplugs < wanted && !is_done()) {
      const Nanoseconds when =
          clock.now() + Nanoseconds{static_cast<std::int64_t>(rng() % static_cast<std::uint64_t>(whole.count() / 4))};
      (void)await([&] { return is_done() || clock.now() >= when; });
      if (is_done()) break;
      host->unplug();
      ++unplugs;
      const bool paused = await([&] { return is_done() || is_paused(); });
      ASSERT_TRUE(paused) << jobs_output() << text_of(job_folder() / "journal");
      if (unplugs == 1) idle_share = std::max(idle_share, processor_share());
      wait_for_dark();
      host->plug();
      if (is_done()) break;
      // News of the plug takes its time; a resume that comes before it ends paused again.
      for (int tries = 0; tries < 20 && is_paused(); ++tries) {
        std::vector<std::string> command{"resume", job, "--site", fab_site()};
        if (jobs_output().find("--as") != std::string::npos) {
          command.insert(command.end(), {"--as", decide()});
          ++unknown;
        }
        ++resumes;
        const test::Outcome resumed = telefab(command);
        // It may have gone on by itself since it was looked at.
        ASSERT_TRUE(resumed.code == 0 || resumed.errors.find("not paused") != std::string::npos) << resumed.errors;
        (void)await([&] { return is_done() || !is_paused(); });
        clock.sleep_for(20ms);
      }
      if (before == 0) before = descriptors();
      most = std::max(most, descriptors());
    }
    for (int tries = 0; !await([&] { return is_done(); }) && tries < kRevivals; ++tries)
      (void)telefab({"resume", job, "--site", fab_site()});
    ASSERT_TRUE(is_done()) << "never finished: " << jobs_output() << text_of(job_folder() / "journal");
    expect_same_part(seen(), reference);
    EXPECT_LE(most, before + 4) << "descriptors leak";
    if (HasFailure()) break;
  }
  idle_share = std::max(idle_share, processor_share());
  EXPECT_LT(idle_share, 0.01);
  EXPECT_EQ(log.light_while_moving(), 0ns);
  for (const LitSpan& lit : log.light()) EXPECT_LE(lit.until - lit.from, 300ms + kFrame);
  fmt::print(
      "{} unplugs of the projector in {} prints of {} lit layers: every part got the same light; {} resumes, {} with a "
      "decision; {} descriptors after the first, {} at most; idle at {:.2f} % of a processor\n",
      unplugs, parts, reference.light.size(), resumes, unknown, before, most, idle_share * 100);
}

}  // namespace
}  // namespace telefab::fab
