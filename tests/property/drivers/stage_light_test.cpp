// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <functional>
#include <telefab/test/stage_lit_rig.hpp>
#include <utility>

// Composed light engines: a screen or a mirror array that shows the mask, and the stage's board that times the light.
// Every way each of them can fail, at every step of a layer, and the host killed between any two of its operations:
// dark, reported, recovered or resumable, and no light beyond the plan.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::DisplayFault;
using test::LitBy;
using test::ShownBy;
using test::StageLitRig;

constexpr std::uint32_t kLayers = 3;
constexpr Nanoseconds kExposure = 700ms;
constexpr Nanoseconds kFrame = 16'667us;

struct Tally {
  int recovered = 0, resumed = 0, decided = 0;
  [[nodiscard]] int all() const { return recovered + resumed + decided; }
};

void expect_sound(StageLitRig& rig, bool partial_allowed) {
  EXPECT_EQ(rig.log.light_while_moving(), 0ns);
  for (const LitSpan& lit : rig.log.light()) EXPECT_LE(lit.until - lit.from, kExposure + kFrame);
  Nanoseconds through_masks{};
  int short_layers = 0;
  for (const PlannedLayer& layer : rig.plan.layers) {
    const Nanoseconds light = rig.light_of(layer.index);
    through_masks += light;
    const double share = double(light.count()) / double(kExposure.count());
    if (share < 0.99) ++short_layers;
    EXPECT_GT(share, 0) << "layer " << layer.index.count() << " was skipped";
    EXPECT_LT(share, 1.01) << "layer " << layer.index.count() << " was exposed twice";
  }
  EXPECT_LE(through_masks, kLayers * (kExposure + kFrame));
  EXPECT_LE(short_layers, partial_allowed ? 1 : 0) << "a layer got too little light and nobody was asked";
}

/// Prints, with the fault planned when layer 1 begins; where it stops, an operator repairs, decides and resumes.
void run_with(StageLitRig& rig, Tally& tally, bool& decided, const std::function<void()>& plan_fault) {
  bool planned = false;
  ASSERT_TRUE(rig.connect());
  const auto first = rig.print({}, [&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Lifting && p.layer == LayerIndex{1} && !std::exchange(planned, true)) plan_fault();
  });
  ASSERT_TRUE(first) << first.error().what;
  rig.tick();
  EXPECT_FALSE(rig.lamp().lit());
  if (first->outcome == PrintOutcome::Done) {
    ++tally.recovered;
    return;
  }
  EXPECT_FALSE(first->cause.what.empty());
  PrintPolicy policy;
  if (first->maybe_exposed) {
    decided = true;
    ++tally.decided;
    rig.clock.advance(2s);
    rig.tick();
    policy.maybe_exposed = rig.light_of(first->next) > 0ns ? Decision::TreatAsExposed : Decision::ExposeAgain;
  }
  rig.dlpc900.power_cycle();
  rig.screen.repair();
  ASSERT_TRUE(rig.connect());
  const auto second = rig.print(policy);
  ASSERT_TRUE(second) << second.error().what;
  EXPECT_EQ(second->outcome, PrintOutcome::Done) << second->cause.what;
  if (!decided) ++tally.resumed;
}

/// How often something counted happens between two lifts.
std::uint64_t steps_of_a_layer(StageLitRig& rig, const std::function<std::uint64_t()>& count) {
  std::uint64_t from = 0, to = 0;
  EXPECT_TRUE(rig.connect());
  (void)rig.print({}, [&](const PrintProgress& p) {
    if (p.phase != PrintPhase::Lifting) return;
    if (p.layer == LayerIndex{1}) from = count();
    if (p.layer == LayerIndex{2}) to = count();
  });
  return to - from;
}

void report(std::string_view engine, std::string_view fault, const Tally& t) {
  fmt::print("{:<22} {:<16} recovered {:3}  resumed {:3}  decided {:3}\n", engine, fault, t.recovered, t.resumed,
             t.decided);
}

struct Engine {
  ShownBy shown;
  LitBy lit;
  const char* name;
};
constexpr Engine kEngines[] = {{ShownBy::Screen, LitBy::GrblSpindle, "screen and GRBL"},
                               {ShownBy::Screen, LitBy::MarlinFan, "screen and Marlin fan"},
                               {ShownBy::Screen, LitBy::MarlinPin, "screen and Marlin pin"},
                               {ShownBy::Dlpc900, LitBy::GrblSpindle, "DLPC900 and GRBL"},
                               {ShownBy::Dlpc900, LitBy::MarlinFan, "DLPC900 and Marlin"}};

class StageLight : public testing::TestWithParam<Engine> {
 protected:
  static StageLitRig rig() { return {GetParam().shown, GetParam().lit, kLayers}; }
  static bool is_grbl() { return GetParam().lit == LitBy::GrblSpindle; }

  /// One fault at each of the steps.
  template <class Plan, class Count>
  static void sweep(std::string_view fault, Count count, Plan plan) {
    std::uint64_t steps = 0;
    {
      StageLitRig r{GetParam().shown, GetParam().lit, kLayers};
      steps = steps_of_a_layer(r, [&] { return count(r); });
    }
    ASSERT_GE(steps, 5u);
    Tally tally;
    for (std::uint64_t n = 0; n < steps; ++n) {
      SCOPED_TRACE(fmt::format("{} at {}", fault, n));
      StageLitRig r{GetParam().shown, GetParam().lit, kLayers};
      bool decided = false;
      run_with(r, tally, decided, [&] { plan(r, n); });
      if (!testing::Test::HasFatalFailure()) expect_sound(r, decided);
      if (testing::Test::HasFailure()) return;
    }
    report(GetParam().name, fault, tally);
    EXPECT_EQ(static_cast<std::uint64_t>(tally.all()), steps);
  }
};

TEST_P(StageLight, GivesEveryLayerItsTimeThroughItsMaskAndNothingElse) {
  StageLitRig r{GetParam().shown, GetParam().lit, kLayers};
  ASSERT_TRUE(r.connect());
  const auto record = r.print();
  ASSERT_TRUE(record) << record.error().what;
  ASSERT_EQ(record->outcome, PrintOutcome::Done) << record->cause.what;
  EXPECT_TRUE(compare(*record, r.plan).empty());
  expect_sound(r, false);
  EXPECT_EQ(r.log.light().size(), kLayers);
  for (const LitSpan& lit : r.log.light()) EXPECT_EQ(lit.until - lit.from, kExposure);
  for (const PlannedLayer& layer : r.plan.layers) EXPECT_EQ(r.light_of(layer.index), kExposure);
}

TEST_P(StageLight, RecoversOrStopsDarkWhateverTheBoardDoesAtEveryLine) {
  const auto lines = [](StageLitRig& r) { return r.lines(); };
  if (is_grbl())
    for (std::size_t f = 0; f < kStageFaults; ++f)
      sweep(name_of(static_cast<StageFault>(f)), lines,
            [&](StageLitRig& r, std::uint64_t n) { r.grbl.plan_fault(static_cast<StageFault>(f), n); });
  else
    for (std::size_t f = 0; f < kMarlinFaults; ++f)
      sweep(name_of(static_cast<MarlinFault>(f)), lines,
            [&](StageLitRig& r, std::uint64_t n) { r.marlin.plan_fault(static_cast<MarlinFault>(f), n); });
}

TEST_P(StageLight, RecoversOrStopsDarkWhateverThePictureDoesAtEveryStep) {
  if (GetParam().shown == ShownBy::Screen)
    for (std::size_t f = 0; f < test::kDisplayFaults; ++f)
      sweep(
          test::name_of(static_cast<DisplayFault>(f)), [](StageLitRig& r) { return r.screen.calls(); },
          [&](StageLitRig& r, std::uint64_t n) { r.screen.plan_fault(static_cast<DisplayFault>(f), n); });
  else
    for (std::size_t f = 0; f < kProjectorFaults; ++f)
      sweep(
          name_of(static_cast<ProjectorFault>(f)), [](StageLitRig& r) { return r.dlpc900.transfers(); },
          [&](StageLitRig& r, std::uint64_t n) { r.dlpc900.plan_fault(static_cast<ProjectorFault>(f), n); });
}

TEST_P(StageLight, EndsAsPlannedWhereItsHostIsKilledBetweenAnyTwoOperations) {
  std::uint64_t whole = 0;
  {
    StageLitRig r{GetParam().shown, GetParam().lit, kLayers};
    ASSERT_TRUE(r.connect());
    ASSERT_TRUE(r.print());
    whole = r.life.operations;
  }
  ASSERT_GT(whole, 150u);
  const std::uint64_t stride = std::max<std::uint64_t>(1, whole / 300);
  int tried = 0, lit_at_death = 0;
  for (std::uint64_t n = 0; n < whole; n += stride) {
    SCOPED_TRACE(fmt::format("killed at {} of {}", n, whole));
    StageLitRig r{GetParam().shown, GetParam().lit, kLayers};
    r.life.left = n;
    try {
      if (r.connect()) (void)r.print();
      continue;  // it ended first
    } catch (const test::Life::End&) {
    }
    ++tried;
    r.tick();
    lit_at_death += r.lamp().lit() ? 1 : 0;
    r.bury();
    r.clock.advance(5s);
    r.tick();
    EXPECT_FALSE(r.lamp().lit());
    PrintPolicy policy;
    const auto point = r.journal.resume_point();
    if (point.maybe_exposed)
      policy.maybe_exposed = r.light_of(point.next) > 0ns ? Decision::TreatAsExposed : Decision::ExposeAgain;
    ASSERT_TRUE(r.connect());
    const auto record = r.print(policy);
    ASSERT_TRUE(record) << record.error().what;
    EXPECT_EQ(record->outcome, PrintOutcome::Done) << record->cause.what;
    expect_sound(r, point.maybe_exposed);
    if (HasFailure()) return;
  }
  fmt::print("{:<22} killed {} times, {} of them lit\n", GetParam().name, tried, lit_at_death);
  EXPECT_GT(tried, 100);
  EXPECT_GT(lit_at_death, 3);
}

INSTANTIATE_TEST_SUITE_P(Engines, StageLight, testing::ValuesIn(kEngines), [](const auto& p) {
  std::string name{p.param.name};
  std::replace(name.begin(), name.end(), ' ', '_');
  return name;
});

}  // namespace
}  // namespace telefab::fab
