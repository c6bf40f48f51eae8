// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>
#include <telefab/test/print_rig.hpp>
#include <utility>

// Every way a device can fail, at every step of a layer. Each print must end "recovered with the right dose" or "dark,
// reported, resumable"; a resumed one must end with every layer exposed once, or decided upon by name.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::PrintRig;

constexpr std::uint32_t kLayers = 3;
constexpr Nanoseconds kFrame = 16'667us;

struct Tally {
  int recovered = 0, resumed = 0, decided_exposed = 0, expose_again = 0;
};

/// Full time of one layer's light; what the recorder saw of it.
Nanoseconds light_of(PrintRig& rig, LayerIndex layer) {
  const Digest want = rig.mirrors_digest(layer);
  Nanoseconds sum{};
  for (const LitSpan& lit : rig.log.light())
    if (lit.mask == want) sum += lit.until - lit.from;
  return sum;
}

void expect_sound(PrintRig& rig, bool partial_allowed) {
  EXPECT_EQ(rig.log.light_while_moving(), 0ns);
  EXPECT_EQ(rig.projector_model.endless_orders(), 0u);
  for (const LitSpan& lit : rig.log.light()) EXPECT_LE(lit.until - lit.from, 700ms + kFrame);
  int short_layers = 0;
  for (const PlannedLayer& layer : rig.plan.layers) {
    const double share = double(light_of(rig, layer.index).count()) / 700e6;
    if (share < 0.99) ++short_layers;
    EXPECT_GT(share, 0) << "layer " << layer.index.count() << " was skipped";
    EXPECT_LT(share, 1.01) << "layer " << layer.index.count() << " was exposed twice";
  }
  EXPECT_LE(short_layers, partial_allowed ? 1 : 0) << "a layer got too little light and nobody was asked";
}

/// Runs job and plans the fault when layer 1 begins (the platform lifts from layer 0).
template <class PlanFault>
void run_with(PrintRig& rig, Tally& tally, bool& decided, PlanFault plan_fault) {
  bool planned = false;
  ASSERT_TRUE(rig.connect());
  const auto first = rig.print({}, [&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Lifting && p.layer == LayerIndex{1} && !std::exchange(planned, true)) plan_fault();
  });
  ASSERT_TRUE(first) << first.error().what;
  rig.projector_model.tick();
  if (first->outcome == PrintOutcome::Done) {
    ++tally.recovered;
    return;
  }
  EXPECT_FALSE(rig.projector_model.lit());
  EXPECT_FALSE(first->cause.what.empty());
  PrintPolicy policy;
  if (first->maybe_exposed) {
    decided = true;
    rig.clock.advance(2s);
    rig.projector_model.tick();
    const bool lit = light_of(rig, first->next) > 0ns;
    policy.maybe_exposed = lit ? Decision::TreatAsExposed : Decision::ExposeAgain;
    ++(lit ? tally.decided_exposed : tally.expose_again);
  }
  // The operator looks after the machine, then resumes.
  rig.projector_model.power_cycle();
  ASSERT_TRUE(rig.connect());
  const auto second = rig.print(policy);
  ASSERT_TRUE(second) << second.error().what;
  EXPECT_EQ(second->outcome, PrintOutcome::Done) << second->cause.what;
  if (!decided) ++tally.resumed;
}

/// Transfers and lines of layer 1, counted on a sound machine.
struct Steps {
  std::uint64_t transfers = 0, lines = 0;
};
Steps steps_of_a_layer(const LayerMotion& motion = {}) {
  PrintRig rig{kLayers, 700ms, motion};
  EXPECT_TRUE(rig.connect());
  Steps from, to;
  (void)rig.print({}, [&](const PrintProgress& p) {
    if (p.phase != PrintPhase::Lifting) return;
    const Steps now{rig.projector_model.transfers(), rig.stage_model.lines()};
    if (p.layer == LayerIndex{1}) from = now;
    if (p.layer == LayerIndex{2}) to = now;
  });
  return {to.transfers - from.transfers, to.lines - from.lines};
}

void print_row(std::string_view fault, const Tally& t) {
  fmt::print("{:<18} recovered {:3}  resumed {:3}  decided exposed {:3}  decided again {:3}\n", fault, t.recovered,
             t.resumed, t.decided_exposed, t.expose_again);
}

class ProjectorFaultMatrix : public testing::TestWithParam<std::size_t> {};

TEST_P(ProjectorFaultMatrix, RecoversOrStopsDarkAtEveryStep) {
  const auto fault = static_cast<ProjectorFault>(GetParam());
  const Steps steps = steps_of_a_layer();
  ASSERT_GE(steps.transfers, 35u);
  Tally tally;
  for (std::uint64_t n = 0; n < steps.transfers; ++n) {
    SCOPED_TRACE(fmt::format("{} at transfer {}", name_of(fault), n));
    PrintRig rig{kLayers};
    bool decided = false;
    run_with(rig, tally, decided, [&] { rig.projector_model.plan_fault(fault, n); });
    expect_sound(rig, decided);
    if (HasFailure()) break;
  }
  print_row(name_of(fault), tally);
  EXPECT_EQ(static_cast<std::uint64_t>(tally.recovered + tally.resumed + tally.decided_exposed + tally.expose_again),
            steps.transfers);
}
INSTANTIATE_TEST_SUITE_P(Faults, ProjectorFaultMatrix, testing::Range<std::size_t>(0, kProjectorFaults),
                         [](const auto& p) {
                           std::string name{name_of(static_cast<ProjectorFault>(p.param))};
                           std::replace(name.begin(), name.end(), ' ', '_');
                           return name;
                         });

class StageFaultMatrix : public testing::TestWithParam<std::size_t> {
 protected:
  static void break_every_line(const LayerMotion& motion, std::uint64_t least_lines) {
    const auto fault = static_cast<StageFault>(GetParam());
    const Steps steps = steps_of_a_layer(motion);
    ASSERT_GE(steps.lines, least_lines);
    Tally tally;
    for (std::uint64_t n = 0; n < steps.lines; ++n) {
      SCOPED_TRACE(fmt::format("{} at line {}", name_of(fault), n));
      PrintRig rig{kLayers, 700ms, motion};
      bool decided = false;
      run_with(rig, tally, decided, [&] { rig.stage_model.plan_fault(fault, n); });
      expect_sound(rig, decided);
    }
    print_row(name_of(fault), tally);
    EXPECT_EQ(static_cast<std::uint64_t>(tally.recovered + tally.resumed + tally.decided_exposed + tally.expose_again),
              steps.lines);
  }
};

TEST_P(StageFaultMatrix, RecoversOrStopsDarkAtEveryLine) { break_every_line({}, 4); }
TEST_P(StageFaultMatrix, RecoversOrStopsDarkAtEveryLineOfTwoStagesWithWaits) {
  break_every_line(test::every_step(), 6);
}
INSTANTIATE_TEST_SUITE_P(Faults, StageFaultMatrix, testing::Range<std::size_t>(0, kStageFaults));

TEST(LightInjection, NeverShinesBeyondItsTimeNorWhileThePlatformMoves) {
  // Stops, cancels, open covers, unplugged cables and silent death at random moments of a job.
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 rng{seed};
    const bool has_every_step = seed % 2 == 1;
    PrintRig rig{2, 700ms, has_every_step ? test::every_step() : LayerMotion{}};
    ASSERT_TRUE(rig.connect());
    const Nanoseconds when = rig.clock.now() + Milliseconds{rng() % (has_every_step ? 33000 : 24000)};
    const int kind = static_cast<int>(rng() % 5);
    struct Dead {};
    class TriggerClock final : public Clock {
     public:
      TriggerClock(VirtualClock& inner, Nanoseconds at, std::function<void()> operation)
          : inner_{inner}, at_{at}, operation_{std::move(operation)} {}
      Nanoseconds now() const override { return inner_.now(); }
      Nanoseconds wall() const override { return inner_.wall(); }
      void sleep_for(Nanoseconds d) override {
        inner_.sleep_for(d);
        if (operation_ && now() >= at_) std::exchange(operation_, {})();
      }

     private:
      VirtualClock& inner_;
      Nanoseconds at_;
      std::function<void()> operation_;
    };
    std::stop_source stop;
    TriggerClock clock{rig.clock, when, [&] {
                         if (kind == 0) stop.request_stop();
                         if (kind == 1) rig.control.cancel();
                         if (kind == 2) rig.control.open_interlock();
                         if (kind == 3) rig.projector_model.plan_fault(ProjectorFault::Unplug, 0);
                         if (kind == 4) throw Dead{};
                       }};
    PrintRunner runner{*rig.projector, *rig.stage, rig.masks, rig.journal, clock};
    try {
      const auto record = runner.run(rig.plan, {}, rig.control, {}, stop.get_token());
      ASSERT_TRUE(record) << record.error().what;
      rig.projector_model.tick();
      EXPECT_FALSE(rig.projector_model.lit());
    } catch (const Dead&) {
      rig.clock.advance(2s);  // nobody is left to switch it off; the controller does
      rig.projector_model.tick();
      EXPECT_FALSE(rig.projector_model.lit());
    }
    for (const LitSpan& lit : rig.log.light()) EXPECT_LE(lit.until - lit.from, 700ms + kFrame);
    EXPECT_EQ(rig.log.light_while_moving(), 0ns);
  }
}

}  // namespace
}  // namespace telefab::fab
