// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <functional>
#include <random>
#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/test/print_rig.hpp>

// Kill the daemon anywhere: between any two calls it makes, with the unsynced tail of its journal lost. The devices
// live on, as real ones do.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::FormulaMasks;

constexpr PixelSize kSize{24, 16};
constexpr std::uint32_t kLayers = 5;
constexpr Nanoseconds kExposure = 700ms;

struct Killed {};

/// Counts what the daemon does and kills it at the n-th operation.
class KillSwitch {
 public:
  void arm(std::uint64_t after) { left_ = after; }
  void disarm() { left_ = UINT64_MAX; }
  void operation() {
    ++operations_;
    if (left_ != UINT64_MAX && left_-- == 0) {
      disarm();
      dead_ = true;
      throw Killed{};
    }
  }
  void revive() { dead_ = false; }
  [[nodiscard]] std::uint64_t operations() const { return operations_; }

 private:
  std::uint64_t left_ = UINT64_MAX;
  std::uint64_t operations_ = 0;
  bool dead_ = false;
};

template <class F>
auto watched(KillSwitch& kill, F operation) {
  kill.operation();
  auto result = operation();
  kill.operation();
  return result;
}

class KillableProjector final : public Projector {
 public:
  KillableProjector(Projector& inner, KillSwitch& kill) : inner_{inner}, kill_{kill} {}
  const ProjectorFacts& facts() const override { return inner_.facts(); }
  Result<void> load(const MaskView& m, const LightOrder& light) override {
    return watched(kill_, [&] { return inner_.load(m, light); });
  }
  Result<void> expose() override {
    return watched(kill_, [&] { return inner_.expose(); });
  }
  Result<ProjectorStatus> poll() override {
    return watched(kill_, [&] { return inner_.poll(); });
  }
  Result<void> dark() override {
    return watched(kill_, [&] { return inner_.dark(); });
  }
  Nanoseconds load_time(const MaskView& m) const override { return inner_.load_time(m); }

 private:
  Projector& inner_;
  KillSwitch& kill_;
};

class KillableStage final : public ZStage {
 public:
  KillableStage(ZStage& inner, KillSwitch& kill) : inner_{inner}, kill_{kill} {}
  const StageFacts& facts() const override { return inner_.facts(); }
  Result<void> home() override {
    return watched(kill_, [&] { return inner_.home(); });
  }
  Result<void> move_along(std::span<const StageLeg> legs) override {
    return watched(kill_, [&] { return inner_.move_along(legs); });
  }
  Result<void> tilt(Nanoseconds duration) override {
    return watched(kill_, [&] { return inner_.tilt(duration); });
  }
  Result<StageStatus> poll() override { return inner_.poll(); }
  Result<void> hold() override {
    return watched(kill_, [&] { return inner_.hold(); });
  }

 private:
  ZStage& inner_;
  KillSwitch& kill_;
};

/// A disk: what was synced survives, of the rest a random beginning.
struct Disk {
  std::string safe, unsafe;
  void crash(std::mt19937_64& rng) {
    safe += unsafe.substr(0, rng() % (unsafe.size() + 1));
    unsafe.clear();
  }
};

class DroppingFile final : public JournalFile {
 public:
  DroppingFile(Disk& disk, KillSwitch& kill) : disk_{disk}, kill_{kill} {}
  Result<std::string> read_all() override { return disk_.safe + disk_.unsafe; }
  Result<void> append(std::string_view text) override {
    return watched(kill_, [&]() -> Result<void> {
      disk_.unsafe += text;
      return {};
    });
  }
  Result<void> sync() override {
    return watched(kill_, [&]() -> Result<void> {
      disk_.safe += disk_.unsafe;
      disk_.unsafe.clear();
      return {};
    });
  }
  Result<void> truncate(std::uint64_t bytes) override {
    std::string all = disk_.safe + disk_.unsafe;
    all.resize(bytes);
    disk_.safe = all;
    disk_.unsafe.clear();
    return {};
  }
  Result<void> set_aside(std::string_view text) override {
    disk_.safe = text;
    disk_.unsafe.clear();
    return {};
  }
  Result<void> reserve(std::uint64_t) override { return {}; }

 private:
  Disk& disk_;
  KillSwitch& kill_;
};

class KillClock final : public Clock {
 public:
  KillClock(VirtualClock& inner, KillSwitch& kill) : inner_{inner}, kill_{kill} {}
  Nanoseconds now() const override { return inner_.now(); }
  Nanoseconds wall() const override { return inner_.wall(); }
  void sleep_for(Nanoseconds d) override {
    kill_.operation();
    inner_.sleep_for(d);
  }

 private:
  VirtualClock& inner_;
  KillSwitch& kill_;
};

/// A machine, and daemons that come and go.
struct Site {
  explicit Site(const PrintPlan& p) : plan{p} {}

  [[nodiscard]] Nanoseconds light_of(LayerIndex layer) const {
    Nanoseconds sum{};
    for (const LitSpan& lit : log.light())
      if (lit.mask == plan.layers[layer.count()].mask) sum += lit.until - lit.from;
    return sum;
  }

  /// One life of the daemon. True: the print is done.
  bool live(std::uint64_t kill_after, const PrintPolicy& policy) {
    kill.arm(kill_after);
    try {
      KillableProjector p{projector, kill};
      KillableStage s{stage, kill};
      KillClock c{clock, kill};
      auto journal = PrintJournal::open(std::make_unique<DroppingFile>(disk, kill));
      EXPECT_TRUE(journal);
      next = journal->resume_point();
      PrintRunner runner{p, s, masks, *journal, c};
      PrintControl control;
      const auto record = runner.run(plan, policy, control, {}, {});
      kill.disarm();
      EXPECT_TRUE(record) << record.error().what;
      EXPECT_EQ(record->outcome, PrintOutcome::Done) << record->cause.what;
      if (record->outcome == PrintOutcome::Done && decisions == 0) {
        EXPECT_TRUE(compare(*record, plan).empty());
      }
      return true;
    } catch (const Killed&) {
      return false;
    }
  }

  /// After a kill: what the journal says, decided by what the recorder saw.
  [[nodiscard]] PrintPolicy decide() {
    PrintPolicy policy;
    auto journal = PrintJournal::open(std::make_unique<DroppingFile>(disk, kill));
    const ResumePoint point = journal->resume_point();
    if (!point.maybe_exposed) return policy;
    ++decisions;
    (void)projector.dark();  // so that the recorder has written everything down
    policy.maybe_exposed = light_of(point.next) > 0ns ? Decision::TreatAsExposed : Decision::ExposeAgain;
    return policy;
  }

  const PrintPlan& plan;
  FormulaMasks masks{kSize};
  VirtualClock clock;
  MachineLog log;
  VirtualProjector projector{kSize, 0, clock, log};
  VirtualZStage stage{25, clock, log};
  Disk disk;
  KillSwitch kill;
  ResumePoint next;
  int decisions = 0;
};

PrintPlan job(const LayerMotion& motion) {
  FormulaMasks masks{kSize};
  PrintPlan plan =
      test::formula_plan(masks, kSize, kLayers, std::chrono::duration_cast<Microseconds>(kExposure), motion);
  if (motion != LayerMotion{})
    for (PlannedLayer& layer : plan.layers) layer.light_share = layer.index.count() % 2 == 0 ? 1 : 0.4;
  return plan;
}

struct Case {
  const char* name;
  LayerMotion motion;
};

class Kill : public testing::TestWithParam<Case> {
 protected:
  const PrintPlan plan = job(GetParam().motion);
};
INSTANTIATE_TEST_SUITE_P(Motions, Kill,
                         testing::Values(Case{"Plain", {}}, Case{"EveryStep", test::every_step_and_tilt()},
                                         Case{"TiltAlone", test::tilt_alone()}),
                         [](const auto& p) { return std::string{p.param.name}; });

std::uint64_t operations_of_a_print(const PrintPlan& plan) {
  Site site{plan};
  EXPECT_TRUE(site.live(UINT64_MAX, {}));
  return site.kill.operations();
}

TEST_P(Kill, NeitherSkipsNorDoublesALayerAtTenThousandPoints) {
  const std::uint64_t operations = operations_of_a_print(plan);
  ASSERT_GT(operations, 300u);
  int decided = 0, partial = 0;
  for (std::uint64_t i = 0; i < 10'000; ++i) {
    std::mt19937_64 rng{i};
    Site site{plan};
    if (site.live(i % operations, {})) continue;
    site.clock.advance(Milliseconds{rng() % 1500});
    site.disk.crash(rng);
    const PrintPolicy policy = site.decide();
    ASSERT_TRUE(site.live(UINT64_MAX, policy)) << i;
    decided += site.decisions;
    ASSERT_EQ(site.log.light_while_moving(), 0ns) << i;
    for (const PlannedLayer& layer : plan.layers) {
      const Nanoseconds lit = site.light_of(layer.index);
      const bool whole = lit == kExposure;
      // Cut short by the light-off of a quick restart: only after an explicit decision.
      const bool cut = lit > 0ns && lit < kExposure && site.decisions > 0;
      partial += cut;
      ASSERT_TRUE(whole || cut) << "kill " << i << ", layer " << layer.index.count() << ": " << lit.count() << " ns";
    }
  }
  fmt::print("10000 kills over {} operations: {} explicit decisions, {} of them on a layer that was cut short\n",
             operations, decided, partial);
  EXPECT_GT(decided, 100);
}

TEST_P(Kill, EndsWithTheSameLightInEveryVoxelHoweverOftenItIsKilled) {
  const std::uint64_t operations = operations_of_a_print(plan);
  int kills = 0;
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    std::mt19937_64 rng{seed + 77};
    Site site{plan};
    PrintPolicy policy;
    for (int life = 0; life < 6 && !site.live(life == 5 ? UINT64_MAX : rng() % operations, policy); ++life) {
      ++kills;
      site.clock.advance(2s);  // a restart takes longer than the exposure, which ends by itself
      site.disk.crash(rng);
      policy = site.decide();
    }
    const auto light = site.log.light();
    ASSERT_EQ(light.size(), plan.layers.size()) << seed;
    for (std::size_t k = 0; k < light.size(); ++k) {
      ASSERT_EQ(light[k].mask, plan.layers[k].mask) << seed;
      ASSERT_EQ(light[k].until - light[k].from, kExposure) << seed;
      ASSERT_NEAR(light[k].z_mm, plan.layers[k].z_mm, 1e-9) << seed;
      ASSERT_EQ(light[k].share, plan.layers[k].light_share) << seed;
    }
  }
  fmt::print("500 prints, {} kills: light identical in all\n", kills);
  EXPECT_GT(kills, 500);
}

}  // namespace
}  // namespace telefab::fab
