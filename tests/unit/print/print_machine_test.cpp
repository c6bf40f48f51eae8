// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <telefab/fab/print/print_machine.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;

LayerIndex at(std::uint32_t n) { return LayerIndex{n}; }

PrintPlan four_layers() {
  PrintPlan plan;
  plan.mask_size = {4, 3};
  plan.z_travel_mm = 10;
  for (std::uint32_t i = 0; i < 4; ++i) plan.layers.push_back({at(i), 0.1 * (i + 1), 1s, {}});
  plan.layers[2].exposure = 0us;
  return plan;
}

/// The same with a wait wherever there can be one, lifts and lowerings in two parts, and a vat that tips.
PrintPlan four_layers_with_every_step() {
  PrintPlan plan = four_layers();
  for (PlannedLayer& layer : plan.layers)
    layer.motion = {.approach_mm = 1,
                    .approach_speed_mm_per_s = 1,
                    .wait_after_exposure_s = 0.3,
                    .tilt_s = 1,
                    .peel_mm = 2,
                    .peel_speed_mm_per_s = 1,
                    .wait_after_lift_s = 0.5};
  return plan;
}

const PrintPlan kPlan = four_layers();
const PrintPlan kStepsPlan = four_layers_with_every_step();
constexpr Ticket kMove{7}, kMask{5}, kLast{7};
const Error kCause{ErrorCode::DeviceLost, "gone"};

/// Layer 2 is empty.
LayerIndex next_of(LayerIndex k) { return at(k.count() == 1 ? 3 : k.count() + 1); }

std::vector<PrintState> every_state() {
  static_assert(std::variant_size_v<PrintState> == 17, "add the new state below");
  std::vector<PrintState> states{Idle{}, Done{at(4)}, Cancelled{at(1)}};
  for (const LayerIndex k : {at(0), at(1), at(3)}) {
    states.insert(states.end(), {AwaitingDecision{k}, Retreating{k, kMove}, Paused{k}, Finishing{at(4), kMove},
                                 Cancelling{k, kMove}, Faulted{k, false, kCause}, Faulted{k, true, kCause}});
    for (const bool pause : {false, true}) {
      states.insert(states.end(),
                    {Homing{k, kMove, pause}, Exposing{k, kMove, pause ? AfterExposure::Pause : AfterExposure::GoOn}});
      for (const bool loaded : {false, true})
        states.insert(
            states.end(),
            {Lowering{k, kMove, {kMask, loaded}, pause}, Settling{k, kMove, {kMask, loaded}, pause},
             Resting{k, next_of(k), kMove, {kMask, loaded}, pause},
             Tilting{k, next_of(k), kMove, {kMask, loaded}, pause},
             Lifting{k, next_of(k), kMove, {kMask, loaded}, pause}, Draining{k, next_of(k), kMove, {kMask, loaded}}});
    }
  }
  return states;
}

std::vector<PrintEvent> every_event() {
  static_assert(std::variant_size_v<PrintEvent> == 16, "add the new event below");
  std::vector<PrintEvent> events{DeviceFailed{kCause},
                                 InterlockOpened{},
                                 WrongTemperature{60, true},
                                 PauseAsked{"ana"},
                                 ResumeAsked{"ana"},
                                 CancelAsked{"ana"},
                                 RetryAsked{},
                                 StartAsked{{at(0), false}},
                                 StartAsked{{at(1), true}},
                                 StartAsked{{at(4), false}},
                                 StopAsked{true},
                                 StopAsked{false}};
  for (const auto d : {Decision::ExposeAgain, Decision::TreatAsExposed, Decision::GiveUp})
    events.emplace_back(DecisionMade{d, "ana"});
  for (const Ticket t : {kMove, kMask, Ticket{3}}) {
    events.insert(events.end(), {MoveDone{t}, MaskLoaded{t}, TimerDone{t}, ExposureDone{t}, ExposureRefused{t, kCause},
                                 LeaveRefused{t, kCause}});
  }
  return events;
}

template <class C>
bool asks_for(const Step& step) {
  return std::any_of(step.commands.begin(), step.commands.end(),
                     [](const PrintCommand& c) { return std::holds_alternative<C>(c); });
}

template <class F>
void for_every_step(F check) {
  int steps = 0;
  for (const PrintState& from : every_state())
    for (const PrintEvent& event : every_event()) {
      SCOPED_TRACE(std::string{name_of(from)} + ", event " + std::to_string(event.index()));
      for (const PrintPlan& plan : {kPlan, kStepsPlan}) check(from, event, next(plan, from, event, kLast));
      ++steps;
    }
  EXPECT_GT(steps, 1500);
}

bool starts_motion(const Step& s) { return asks_for<GoHome>(s) || asks_for<MoveAlong>(s) || asks_for<Tilt>(s); }

TEST(PrintMachine, LeavesExposureOnlyWithTheLightOffFirst) {
  for_every_step([](const PrintState& from, const PrintEvent&, const Step& step) {
    if (may_be_lit(from) && !may_be_lit(step.state)) {
      ASSERT_FALSE(step.commands.empty());
      EXPECT_TRUE(std::holds_alternative<LightOff>(step.commands.front()));
    }
  });
}

TEST(PrintMachine, NeverLightsAndMovesInOneStep) {
  for_every_step([](const PrintState& from, const PrintEvent&, const Step& step) {
    if (asks_for<Expose>(step)) {
      EXPECT_FALSE(starts_motion(step));
      EXPECT_FALSE(may_move(from)) << "the platform may still be in motion";
    }
    EXPECT_FALSE(may_be_lit(step.state) && starts_motion(step));
  });
}

TEST(PrintMachine, ExposesOnlyWhatTheJournalKnowsAbout) {
  for_every_step([](const PrintState&, const PrintEvent&, const Step& step) {
    for (std::size_t i = 0; i < step.commands.size(); ++i)
      if (const auto* expose = std::get_if<Expose>(&step.commands[i])) {
        ASSERT_GT(i, 0u);
        const auto* entry = std::get_if<WriteJournal>(&step.commands[i - 1]);
        ASSERT_NE(entry, nullptr);
        EXPECT_EQ(entry->step, JournalStep::Exposing);
        EXPECT_EQ(entry->layer, expose->layer);
        EXPECT_TRUE(may_be_lit(step.state));
      }
  });
}

TEST(PrintMachine, ExposesOnlyFromSettlingAndOnlyItsOwnLayer) {
  for_every_step([](const PrintState& from, const PrintEvent&, const Step& step) {
    if (!asks_for<Expose>(step)) return;
    ASSERT_TRUE(std::holds_alternative<Settling>(from));
    EXPECT_EQ(layer_of(from), layer_of(step.state));
  });
}

TEST(PrintMachine, CallsALayerExposedOnlyWhenTheDeviceSaidSo) {
  for_every_step([](const PrintState& from, const PrintEvent& event, const Step& step) {
    for (const PrintCommand& c : step.commands)
      if (const auto* entry = std::get_if<WriteJournal>(&c); entry != nullptr && entry->step == JournalStep::Exposed) {
        EXPECT_TRUE(std::holds_alternative<Exposing>(from) && std::holds_alternative<ExposureDone>(event));
        EXPECT_EQ(entry->layer, layer_of(from));
      }
  });
}

TEST(PrintMachine, NeverSkipsALayerThatNeedsLight) {
  for_every_step([](const PrintState& from, const PrintEvent& event, const Step& step) {
    if (std::holds_alternative<Idle>(from) || is_final(step.state)) return;
    const auto* decision = std::get_if<DecisionMade>(&event);
    const std::uint32_t before = layer_of(from).count();
    const std::uint32_t after = layer_of(step.state).count();
    for (std::uint32_t k = before; k < after && k < kPlan.layers.size(); ++k) {
      const bool exposed =
          k == before && std::holds_alternative<Exposing>(from) && std::holds_alternative<ExposureDone>(event);
      const bool decided = k == before && decision != nullptr && decision->decision == Decision::TreatAsExposed;
      EXPECT_TRUE(exposed || decided || kPlan.layers[k].exposure == 0us) << "layer " << k;
    }
    EXPECT_GE(after, before) << "went back to a layer that was left";
  });
}

TEST(PrintMachine, LightsNoEmptyLayer) {
  for (std::uint32_t k = 0; k < 4; ++k) {
    const Step step = next(kPlan, Idle{}, StartAsked{{at(k), false}}, kLast);
    EXPECT_NE(layer_of(step.state), at(2));
  }
}

TEST(PrintMachine, IgnoresRepliesWithAnOldTicket) {
  for (const PrintState& from : every_state())
    for (const PrintEvent& event :
         std::vector<PrintEvent>{MoveDone{Ticket{3}}, MaskLoaded{Ticket{3}}, TimerDone{Ticket{3}},
                                 ExposureDone{Ticket{3}}, ExposureRefused{Ticket{3}, kCause}}) {
      const Step step = next(kPlan, from, event, kLast);
      EXPECT_EQ(step.state.index(), from.index()) << name_of(from);
      EXPECT_TRUE(step.commands.empty()) << name_of(from);
    }
}

TEST(PrintMachine, AnyFaultAtWorkEndsDarkAndAtRest) {
  for (const PrintState& from : every_state())
    for (const PrintEvent& event : std::vector<PrintEvent>{DeviceFailed{kCause}, InterlockOpened{},
                                                           WrongTemperature{70, true}, WrongTemperature{5, false}}) {
      const bool idle = is_final(from) || std::holds_alternative<Idle>(from) || std::holds_alternative<Faulted>(from) ||
                        std::holds_alternative<AwaitingDecision>(from);
      if (idle) continue;
      const Step step = next(kPlan, from, event, kLast);
      const auto* faulted = std::get_if<Faulted>(&step.state);
      ASSERT_NE(faulted, nullptr) << name_of(from);
      EXPECT_EQ(faulted->maybe_exposed, may_be_lit(from));
      ASSERT_EQ(step.commands.size(), 3u);
      EXPECT_TRUE(std::holds_alternative<LightOff>(step.commands[0]));
      EXPECT_TRUE(std::holds_alternative<HoldStage>(step.commands[1]));
      EXPECT_EQ(std::get<WriteJournal>(step.commands[2]).step, JournalStep::Faulted);
    }
}

TEST(PrintMachine, AsksBeforeItTouchesALayerThatWasPerhapsExposed) {
  for (const PrintState& from : {PrintState{Idle{}}, PrintState{Faulted{at(1), true, kCause}}}) {
    const PrintEvent event =
        std::holds_alternative<Idle>(from) ? PrintEvent{StartAsked{{at(1), true}}} : PrintEvent{ResumeAsked{}};
    const Step step = next(kPlan, from, event, kLast);
    ASSERT_TRUE(std::holds_alternative<AwaitingDecision>(step.state));
    EXPECT_FALSE(starts_motion(step));
    const Step again = next(kPlan, step.state, DecisionMade{Decision::ExposeAgain, "ana"}, kLast);
    EXPECT_EQ(layer_of(again.state), at(1));
    const Step after = next(kPlan, step.state, DecisionMade{Decision::TreatAsExposed, "ana"}, kLast);
    EXPECT_EQ(layer_of(after.state), at(3)) << "layer 2 is empty";
    EXPECT_TRUE(
        std::holds_alternative<Cancelled>(next(kPlan, step.state, DecisionMade{Decision::GiveUp, "ana"}, kLast).state));
  }
}

TEST(PrintMachine, WritesDownWhoDecided) {
  for (const Decision d : {Decision::ExposeAgain, Decision::TreatAsExposed}) {
    const Step step = next(kPlan, AwaitingDecision{at(1)}, DecisionMade{d, "ana"}, kLast);
    const auto* entry = std::get_if<WriteJournal>(&step.commands.front());
    ASSERT_NE(entry, nullptr);
    EXPECT_EQ(entry->by, "ana");
    EXPECT_EQ(entry->layer, at(1));
  }
}

TEST(PrintMachine, AnOrderlyStopLeavesNoStateAtWorkNorLit) {
  for (const PrintState& from : every_state()) {
    SCOPED_TRACE(name_of(from));
    const Step step = next(kPlan, from, StopAsked{false}, kLast);
    EXPECT_TRUE(is_final(step.state) || std::holds_alternative<Faulted>(step.state));
    EXPECT_FALSE(starts_motion(step));
    EXPECT_EQ(layer_of(step.state), layer_of(from));
    if (is_final(from) || std::holds_alternative<Faulted>(from)) continue;
    EXPECT_EQ(std::get<Faulted>(step.state).maybe_exposed,
              may_be_lit(from) || std::holds_alternative<AwaitingDecision>(from));
    const auto* last = std::get_if<WriteJournal>(&step.commands.back());
    ASSERT_NE(last, nullptr);
    EXPECT_EQ(last->step, JournalStep::Stopped);
  }
}

TEST(PrintMachine, AStopThatWaitsForTheLightLeavesTheLayerExposedAndAllElseForbidden) {
  Step step = next(kPlan, Exposing{at(0), Ticket{12}, AfterExposure::GoOn}, StopAsked{true}, kLast);
  ASSERT_TRUE(may_be_lit(step.state));
  EXPECT_TRUE(step.commands.empty());
  for (const PrintEvent& event : std::vector<PrintEvent>{PauseAsked{}, ResumeAsked{}})
    step = next(kPlan, step.state, event, kLast);
  step = next(kPlan, step.state, ExposureDone{Ticket{12}}, kLast);
  const auto* faulted = std::get_if<Faulted>(&step.state);
  ASSERT_NE(faulted, nullptr);
  EXPECT_FALSE(faulted->maybe_exposed);
  EXPECT_EQ(faulted->next, at(1));
  EXPECT_EQ(faulted->cause.code, ErrorCode::Cancelled);
  EXPECT_FALSE(starts_motion(step));
}

TEST(PrintMachine, KeepsAWordBeforeAnythingMovesOrEndsOnIt) {
  for (const PrintState& from : every_state())
    for (const auto& [event, kept] :
         std::vector<std::pair<PrintEvent, JournalStep>>{{PauseAsked{"ana"}, JournalStep::PauseAsked},
                                                         {ResumeAsked{"ana"}, JournalStep::Resumed},
                                                         {CancelAsked{"ana"}, JournalStep::CancelAsked}}) {
      SCOPED_TRACE(std::string{name_of(from)} + ", " + std::string{name_of(kept)});
      const Step step = next(kPlan, from, event, kLast);
      const bool is_over = is_final(from) || std::holds_alternative<Finishing>(from) ||
                           std::holds_alternative<Cancelling>(from) || std::holds_alternative<Idle>(from);
      bool is_kept = false;
      for (const PrintCommand& c : step.commands) {
        if (const auto* entry = std::get_if<WriteJournal>(&c); entry != nullptr && entry->step == kept) {
          is_kept = true;
          EXPECT_EQ(entry->by, "ana");
        } else if (!is_over) {
          EXPECT_TRUE(is_kept || std::holds_alternative<LightOff>(c) || std::holds_alternative<HoldStage>(c));
        }
      }
      EXPECT_EQ(is_kept, !is_over);
    }
}

TEST(PrintMachine, EndsCancelledWithALineThatSaysSo) {
  for_every_step([](const PrintState& from, const PrintEvent&, const Step& step) {
    if (!std::holds_alternative<Cancelled>(step.state) || is_final(from)) return;
    const auto* last = std::get_if<WriteJournal>(&step.commands.back());
    ASSERT_NE(last, nullptr);
    EXPECT_EQ(last->step, JournalStep::Cancelled);
  });
}

TEST(PrintMachine, DecidesAboutEveryLayerInQuestionAtOnce) {
  const PrintState asked = AwaitingDecision{at(0), 2};
  const Step exposed = next(kPlan, asked, DecisionMade{Decision::TreatAsExposed, "ana"}, kLast);
  EXPECT_EQ(layer_of(exposed.state), at(3)) << "0 and 1 count as exposed, 2 is empty";
  EXPECT_EQ(layer_of(next(kPlan, asked, DecisionMade{Decision::ExposeAgain, "ana"}, kLast).state), at(0));
}

TEST(PrintMachine, HandsOutATicketNobodyHolds) {
  for_every_step([](const PrintState&, const PrintEvent&, const Step& step) {
    for (const PrintCommand& c : step.commands)
      std::visit(
          [](const auto& command) {
            if constexpr (requires { command.move; }) {
              EXPECT_GT(command.move, kLast);
            }
            if constexpr (requires { command.mask; }) {
              EXPECT_GT(command.mask, kLast);
            }
            if constexpr (requires { command.timer; }) {
              EXPECT_GT(command.timer, kLast);
            }
            if constexpr (requires { command.exposure; }) {
              EXPECT_GT(command.exposure, kLast);
            }
          },
          c);
  });
}

TEST(PrintMachine, GoesThroughEveryStepOfALayerInItsOrder) {
  PrintState state = Exposing{at(0), kMove, AfterExposure::GoOn};
  Ticket last{20};
  std::vector<std::string_view> phases;
  std::optional<Ticket> mask;
  const auto feed = [&](const PrintEvent& event) {
    Step step = next(kStepsPlan, state, event, last);
    state = step.state;
    last = step.last_ticket;
    for (const PrintCommand& command : step.commands)
      if (const auto* load = std::get_if<LoadMask>(&command)) mask = load->mask;
    phases.push_back(name_of(state));
  };
  feed(ExposureDone{kMove});
  ASSERT_TRUE(mask) << "loads from the end of the exposure on";
  const Ticket loading = *mask;
  feed(TimerDone{std::get<Resting>(state).timer});
  feed(MaskLoaded{loading});
  feed(MoveDone{std::get<Tilting>(state).move});
  feed(MoveDone{std::get<Lifting>(state).move});
  feed(TimerDone{std::get<Draining>(state).timer});
  feed(MoveDone{std::get<Lowering>(state).move});
  EXPECT_TRUE(std::get<Settling>(state).mask.done);
  EXPECT_EQ(*mask, loading) << "one loading a layer";
  feed(TimerDone{std::get<Settling>(state).timer});
  EXPECT_THAT(phases, testing::ElementsAre("resting", "tilting", "tilting", "lifting", "draining", "lowering",
                                           "settling", "exposing"));
}

TEST(PrintMachine, LiftsSlowlyAtFirstAndApproachesSlowlyAtLast) {
  const auto path_of = [](const Step& step) {
    for (const PrintCommand& command : step.commands)
      if (const auto* move = std::get_if<MoveAlong>(&command)) return move->legs;
    return std::vector<StageLeg>{};
  };
  const Step lift = next(kStepsPlan, Tilting{at(0), at(1), kMove, {}, false}, MoveDone{kMove}, kLast);
  EXPECT_EQ(path_of(lift), (std::vector<StageLeg>{{0.1 + 2, 1}, {0.1 + 5, 2}}));
  const Step lowering = next(kStepsPlan, Draining{at(0), at(1), kMove, {}}, TimerDone{kMove}, kLast);
  EXPECT_EQ(path_of(lowering), (std::vector<StageLeg>{{0.2 + 1, 3}, {0.2, 1}}));
  const Step plain = next(kPlan, Exposing{at(0), kMove, AfterExposure::GoOn}, ExposureDone{kMove}, kLast);
  EXPECT_EQ(path_of(plain), (std::vector<StageLeg>{{0.1 + 5, 2}})) << "one part, and at once";
}

TEST(PrintMachine, EndsByItselfOnceFinal) {
  for (const PrintEvent& event : every_event())
    for (const PrintState& from : {PrintState{Done{at(4)}}, PrintState{Cancelled{at(2)}}})
      EXPECT_TRUE(next(kPlan, from, event, kLast).commands.empty());
}

}  // namespace
}  // namespace telefab::fab
