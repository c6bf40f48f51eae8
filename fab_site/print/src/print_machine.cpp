// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <telefab/fab/print/print_machine.hpp>
#include <utility>

namespace telefab::fab {

namespace {

template <class... F>
struct overloaded : F... {
  using F::operator()...;
};
template <class... F>
overloaded(F...) -> overloaded<F...>;

using Commands = std::vector<PrintCommand>;

Nanoseconds nanoseconds(double seconds) { return Nanoseconds{static_cast<Nanoseconds::rep>(seconds * 1e9)}; }

/// Hands out tickets and builds the steps that several rows of the table share.
class Builder {
 public:
  Builder(const PrintPlan& plan, Ticket last) : plan_{plan}, last_{last} {}

  [[nodiscard]] Ticket fresh() {
    last_ = Ticket{static_cast<std::uint64_t>(last_) + 1};
    return last_;
  }
  [[nodiscard]] Step to(PrintState state, Commands commands = {}) const {
    return {std::move(state), std::move(commands), last_};
  }
  [[nodiscard]] bool past_end(LayerIndex layer) const { return layer.count() >= plan_.layers.size(); }
  [[nodiscard]] const PlannedLayer& at(LayerIndex layer) const { return plan_.layers[layer.count()]; }

  /// Writes empty layers down as passed and returns the first layer from here that needs light, or the end.
  [[nodiscard]] LayerIndex pass_empty(LayerIndex from, Commands& commands) const {
    while (!past_end(from) && at(from).exposure.count() == 0) {
      commands.emplace_back(WriteJournal{JournalStep::Passed, from, {}, {}});
      from = from + LayerIndex{1};
    }
    return from;
  }

  /// Raise the finished part.
  [[nodiscard]] Step finish(Commands commands) {
    const Ticket move = fresh();
    commands.emplace_back(LightOff{});
    commands.emplace_back(GoHome{move});
    return to(Finishing{end(), move}, std::move(commands));
  }

  /// The platform is at rest above the vat: go down to the layer, loading its mask on the way unless it is on its way.
  [[nodiscard]] Step lower_to(LayerIndex layer, Commands commands, Loading mask, double from_mm) {
    if (mask.ticket == Ticket{}) {
      mask.ticket = fresh();
      commands.emplace_back(LoadMask{mask.ticket, layer});
    }
    const Ticket move = fresh();
    commands.emplace_back(MoveAlong{move, lowering_path(at(layer).motion, at(layer).z_mm, from_mm)});
    return to(Lowering{layer, move, mask, false}, std::move(commands));
  }

  [[nodiscard]] Step home_for(LayerIndex next, Commands commands) {
    next = pass_empty(next, commands);
    if (past_end(next)) return finish(std::move(commands));
    const Ticket move = fresh();
    commands.emplace_back(LightOff{});
    commands.emplace_back(GoHome{move});
    return to(Homing{next, move, false}, std::move(commands));
  }

  /// The light of a layer is over: leave it. The mask of the next one loads meanwhile.
  [[nodiscard]] Step part_from(const Exposing& s) {
    Commands commands{LightOff{}, WriteJournal{JournalStep::Exposed, s.layer, {}, {}}};
    const LayerIndex next = pass_empty(s.layer + LayerIndex{1}, commands);
    if (s.after == AfterExposure::Stop) return stopped(next, false, std::move(commands));
    const bool pause = s.after == AfterExposure::Pause;
    Parting parting{s.layer, next, {}, pause};
    const LayerMotion& motion = at(s.layer).motion;
    Step step;
    if (motion.wait_after_exposure_s > 0) {
      const Ticket timer = fresh();
      commands.emplace_back(StartTimer{timer, nanoseconds(motion.wait_after_exposure_s)});
      step = to(Resting{s.layer, next, timer, {}, pause}, std::move(commands));
    } else {
      step = tilt(parting, std::move(commands));
    }
    if (past_end(next) || pause) return step;
    // Behind what moves, so that motion never waits for a mask to be read.
    const Loading mask{fresh(), false};
    step.commands.emplace_back(LoadMask{mask.ticket, next});
    step.last_ticket = last_;
    std::visit(
        [&](auto& state) {
          if constexpr (requires { state.mask; }) state.mask = mask;
        },
        step.state);
    return step;
  }

  /// What the states from Resting to Lifting share.
  struct Parting {
    LayerIndex layer;
    LayerIndex next;
    Loading mask;
    bool pause_after = false;
  };

  [[nodiscard]] Step tilt(const Parting& p, Commands commands) {
    const LayerMotion& motion = at(p.layer).motion;
    if (motion.tilt_s <= 0) return lift(p, std::move(commands));
    const Ticket move = fresh();
    commands.emplace_back(Tilt{move, nanoseconds(motion.tilt_s)});
    return to(Tilting{p.layer, p.next, move, p.mask, p.pause_after}, std::move(commands));
  }

  [[nodiscard]] Step lift(const Parting& p, Commands commands) {
    auto path = lift_path(at(p.layer).motion, at(p.layer).z_mm);
    if (path.empty()) return after_lift(p, std::move(commands));
    const Ticket move = fresh();
    commands.emplace_back(MoveAlong{move, std::move(path)});
    return to(Lifting{p.layer, p.next, move, p.mask, p.pause_after}, std::move(commands));
  }

  /// Off the film: on top of the lift, or where it was where the vat tips instead.
  [[nodiscard]] Step after_lift(const Parting& p, Commands commands) {
    commands.emplace_back(WriteJournal{JournalStep::Lifted, p.layer, {}, {}});
    if (past_end(p.next)) return finish(std::move(commands));
    const LayerMotion& motion = at(p.layer).motion;
    if (p.pause_after && motion.lift_mm > 0) return to(Paused{p.next}, std::move(commands));
    if (p.pause_after) return raise_to_pause(p.next, std::move(commands));
    if (motion.wait_after_lift_s <= 0) return lower_from_lift(p.layer, p.next, p.mask, std::move(commands));
    const Ticket timer = fresh();
    commands.emplace_back(StartTimer{timer, nanoseconds(motion.wait_after_lift_s)});
    return to(Draining{p.layer, p.next, timer, p.mask}, std::move(commands));
  }

  [[nodiscard]] Step lower_from_lift(LayerIndex layer, LayerIndex next, const Loading& mask, Commands commands) {
    return lower_to(next, std::move(commands), mask, at(layer).z_mm + at(layer).motion.lift_mm);
  }

  [[nodiscard]] Step pause_on_top(const Draining& s) {
    if (at(s.layer).motion.lift_mm > 0) return to(Paused{s.next}, {LightOff{}});
    return raise_to_pause(s.next, {});
  }

  /// A pause never leaves the part in the resin: without a lift it goes to the top.
  [[nodiscard]] Step raise_to_pause(LayerIndex next, Commands commands) {
    const Ticket move = fresh();
    commands.emplace_back(LightOff{});
    commands.emplace_back(GoHome{move});
    return to(Homing{next, move, true}, std::move(commands));
  }

  [[nodiscard]] Step expose_when_ready(const Settling& s) {
    if (!s.settled || !s.mask.done) return to(s);
    const Ticket exposure = fresh();
    return to(Exposing{s.layer, exposure, AfterExposure::GoOn},
              {WriteJournal{JournalStep::Ready, s.layer, {}, {}}, WriteJournal{JournalStep::Exposing, s.layer, {}, {}},
               Expose{exposure, s.layer}});
  }

  [[nodiscard]] Step settle(const Lowering& s) {
    const Ticket timer = fresh();
    return to(Settling{s.layer, timer, s.mask, false}, {StartTimer{timer, nanoseconds(at(s.layer).motion.settle_s)}});
  }

  [[nodiscard]] Step retreat(LayerIndex layer) {
    auto path = lift_path(at(layer).motion, at(layer).z_mm);
    if (path.empty()) return raise_to_pause(layer, {});
    const Ticket move = fresh();
    return to(Retreating{layer, move}, {LightOff{}, MoveAlong{move, std::move(path)}});
  }

  [[nodiscard]] Step cancel(LayerIndex next) {
    const Ticket move = fresh();
    return to(Cancelling{next, move}, {LightOff{}, HoldStage{}, GoHome{move}});
  }

  /// Over, with no word left to say.
  [[nodiscard]] Step cancelled(LayerIndex next) const {
    return to(Cancelled{next}, {LightOff{}, WriteJournal{JournalStep::Cancelled, next, {}, {}}});
  }

  /// Dark and held until somebody, or the runner, tries again.
  [[nodiscard]] Step fault(LayerIndex next, bool maybe_exposed, const Error& cause, Commands commands) const {
    commands.emplace_back(WriteJournal{JournalStep::Faulted, next, {}, cause.what});
    return to(Faulted{next, maybe_exposed, cause}, std::move(commands));
  }

  [[nodiscard]] Step from_fault(const Faulted& s) {
    if (s.maybe_exposed) return to(AwaitingDecision{s.next}, {LightOff{}});
    return home_for(s.next, {});
  }

  /// No leave to light: dark and at rest until somebody outside of the print has it go on.
  [[nodiscard]] Step withheld(const Exposing& s, const Error& cause) const {
    return to(Faulted{s.layer, false, cause},
              {LightOff{}, HoldStage{}, WriteJournal{JournalStep::NotExposed, s.layer, {}, {}},
               WriteJournal{JournalStep::Stopped, s.layer, {}, {}}});
  }

  /// Dark and at rest, to be resumed by the next start of the site.
  [[nodiscard]] Step stopped(LayerIndex next, bool maybe_exposed, Commands commands = {}) const {
    if (commands.empty()) commands.emplace_back(LightOff{});
    commands.emplace_back(HoldStage{});
    commands.emplace_back(WriteJournal{JournalStep::Stopped, next, {}, {}});
    return to(Faulted{next, maybe_exposed, {ErrorCode::Cancelled, "the site stopped; resume the print"}},
              std::move(commands));
  }

  [[nodiscard]] LayerIndex end() const { return LayerIndex{static_cast<std::uint32_t>(plan_.layers.size())}; }

 private:
  const PrintPlan& plan_;
  Ticket last_;
};

/// Anything that must end light and motion at once.
Step stop_on(const PrintState& state, const Error& cause, const Builder& b) {
  const auto* exposing = std::get_if<Exposing>(&state);
  return b.fault(layer_of(state), exposing != nullptr, cause, {LightOff{}, HoldStage{}});
}

template <class State>
Step with_mask(State s, const MaskLoaded& loaded, const Builder& b) {
  if (loaded.mask == s.mask.ticket) s.mask.done = true;
  return b.to(s);
}

template <class State>
Step with_pause(State s, bool pause, const Builder& b) {
  s.pause_after = pause;
  return b.to(s);
}

Step decided(const AwaitingDecision& s, const DecisionMade& made, Builder& b) {
  LayerIndex layer = s.layer;
  switch (made.decision) {
    case Decision::ExposeAgain:
      return b.home_for(layer, {WriteJournal{JournalStep::DecidedExposeAgain, layer, made.by, {}}});
    case Decision::TreatAsExposed: {
      Commands commands;
      for (std::uint32_t k = 0; k < s.in_question && !b.past_end(layer); ++k, layer = layer + LayerIndex{1})
        commands.emplace_back(WriteJournal{JournalStep::DecidedTreatAsExposed, layer, made.by, {}});
      return b.home_for(layer, std::move(commands));
    }
    case Decision::GiveUp:
      return b.cancelled(layer);
  }
  return b.to(s);
}

/// What the journal keeps of an operator's word in this state; nothing where the word changes nothing.
std::optional<WriteJournal> word_of(const PrintState& state, const PrintEvent& event) {
  const bool is_over = is_final(state) || std::holds_alternative<Cancelling>(state) ||
                       std::holds_alternative<Finishing>(state);  // every layer is made
  if (is_over || std::holds_alternative<Idle>(state)) return std::nullopt;
  if (const auto* e = std::get_if<CancelAsked>(&event))
    return WriteJournal{JournalStep::CancelAsked, layer_of(state), e->by, {}};
  if (const auto* e = std::get_if<PauseAsked>(&event))
    return WriteJournal{JournalStep::PauseAsked, layer_of(state), e->by, {}};
  if (const auto* e = std::get_if<ResumeAsked>(&event))
    return WriteJournal{JournalStep::Resumed, layer_of(state), e->by, {}};
  return std::nullopt;
}

Step transition(const PrintPlan& plan, const PrintState& state, const PrintEvent& event, Ticket last_ticket) {
  Builder b{plan, last_ticket};
  const auto stay = [&] { return b.to(state); };

  if (const auto* stop = std::get_if<StopAsked>(&event)) {
    if (is_final(state) || std::holds_alternative<Faulted>(state)) return stay();
    const auto* exposing = std::get_if<Exposing>(&state);
    if (exposing != nullptr && stop->let_exposure_end)
      return b.to(Exposing{exposing->layer, exposing->exposure, AfterExposure::Stop});
    return b.stopped(layer_of(state), exposing != nullptr || std::holds_alternative<AwaitingDecision>(state));
  }

  // Rows that hold in every state where something goes on.
  const bool at_work = !is_final(state) && !std::holds_alternative<Idle>(state) &&
                       !std::holds_alternative<Faulted>(state) && !std::holds_alternative<AwaitingDecision>(state);
  if (at_work) {
    if (const auto* e = std::get_if<DeviceFailed>(&event)) return stop_on(state, e->cause, b);
    if (std::holds_alternative<InterlockOpened>(event))
      return stop_on(state, {ErrorCode::NotPermitted, "the cover was opened; close it and resume"}, b);
    if (const auto* e = std::get_if<WrongTemperature>(&event))
      return stop_on(
          state,
          {ErrorCode::NotPermitted, fmt::format("the resin has {:.1f} degrees, too {}; {} and resume", e->celsius,
                                                e->is_hot ? "hot" : "cold", e->is_hot ? "let it cool" : "warm it")},
          b);
  }

  return std::visit(
      overloaded{
          [&](const Idle&, const StartAsked& e) {
            if (e.from.maybe_exposed) return b.to(AwaitingDecision{e.from.next, e.from.in_question}, {LightOff{}});
            return b.home_for(e.from.next, {});
          },
          [&](const Idle&, const CancelAsked&) { return b.cancelled({}); },

          [&](const AwaitingDecision& s, const DecisionMade& e) { return decided(s, e, b); },
          [&](const AwaitingDecision& s, const CancelAsked&) { return b.cancelled(s.layer); },

          [&](const Homing& s, const MoveDone& e) {
            if (e.move != s.move) return stay();
            if (s.pause_after) return b.to(Paused{s.next});
            return b.lower_to(s.next, {}, {}, std::numeric_limits<double>::infinity());
          },
          [&](const Homing& s, const PauseAsked&) {
            return b.to(Homing{s.next, s.move, true});
          },
          [&](const Homing& s, const ResumeAsked&) {
            return b.to(Homing{s.next, s.move, false});
          },
          [&](const Homing& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Lowering& s, const MoveDone& e) {
            if (e.move != s.move) return stay();
            return s.pause_after ? b.retreat(s.layer) : b.settle(s);
          },
          [&](const Lowering& s, const MaskLoaded& e) {
            if (e.mask != s.mask.ticket) return stay();
            return b.to(Lowering{s.layer, s.move, {s.mask.ticket, true}, s.pause_after});
          },
          [&](const Lowering& s, const PauseAsked&) {
            return b.to(Lowering{s.layer, s.move, s.mask, true});
          },
          [&](const Lowering& s, const ResumeAsked&) {
            return b.to(Lowering{s.layer, s.move, s.mask, false});
          },
          [&](const Lowering& s, const CancelAsked&) { return b.cancel(s.layer); },

          [&](const Settling& s, const TimerDone& e) {
            if (e.timer != s.timer) return stay();
            return b.expose_when_ready({s.layer, s.timer, s.mask, true});
          },
          [&](const Settling& s, const MaskLoaded& e) {
            if (e.mask != s.mask.ticket) return stay();
            return b.expose_when_ready({s.layer, s.timer, {s.mask.ticket, true}, s.settled});
          },
          [&](const Settling& s, const PauseAsked&) { return b.retreat(s.layer); },
          [&](const Settling& s, const CancelAsked&) { return b.cancel(s.layer); },

          // A pause lets a running exposure end: half a dose helps nobody.
          [&](const Exposing& s, const ExposureDone& e) { return e.exposure == s.exposure ? b.part_from(s) : stay(); },
          [&](const Exposing& s, const ExposureRefused& e) {
            if (e.exposure != s.exposure) return stay();
            return b.fault(s.layer, false, e.cause,
                           {LightOff{}, HoldStage{}, WriteJournal{JournalStep::NotExposed, s.layer, {}, {}}});
          },
          [&](const Exposing& s, const LeaveRefused& e) {
            return e.exposure == s.exposure ? b.withheld(s, e.cause) : stay();
          },
          [&](const Exposing& s, const PauseAsked&) {
            return s.after == AfterExposure::Stop ? stay() : b.to(Exposing{s.layer, s.exposure, AfterExposure::Pause});
          },
          [&](const Exposing& s, const ResumeAsked&) {
            return s.after == AfterExposure::Stop ? stay() : b.to(Exposing{s.layer, s.exposure, AfterExposure::GoOn});
          },
          [&](const Exposing& s, const CancelAsked&) { return b.cancel(s.layer); },

          [&](const Resting& s, const TimerDone& e) {
            return e.timer == s.timer ? b.tilt({s.layer, s.next, s.mask, s.pause_after}, {}) : stay();
          },
          [&](const Resting& s, const MaskLoaded& e) { return with_mask(s, e, b); },
          [&](const Resting& s, const PauseAsked&) { return with_pause(s, true, b); },
          [&](const Resting& s, const ResumeAsked&) { return with_pause(s, false, b); },
          [&](const Resting& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Tilting& s, const MoveDone& e) {
            return e.move == s.move ? b.lift({s.layer, s.next, s.mask, s.pause_after}, {}) : stay();
          },
          [&](const Tilting& s, const MaskLoaded& e) { return with_mask(s, e, b); },
          [&](const Tilting& s, const PauseAsked&) { return with_pause(s, true, b); },
          [&](const Tilting& s, const ResumeAsked&) { return with_pause(s, false, b); },
          [&](const Tilting& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Lifting& s, const MoveDone& e) {
            return e.move == s.move ? b.after_lift({s.layer, s.next, s.mask, s.pause_after}, {}) : stay();
          },
          [&](const Lifting& s, const MaskLoaded& e) { return with_mask(s, e, b); },
          [&](const Lifting& s, const PauseAsked&) { return with_pause(s, true, b); },
          [&](const Lifting& s, const ResumeAsked&) { return with_pause(s, false, b); },
          [&](const Lifting& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Draining& s, const TimerDone& e) {
            return e.timer == s.timer ? b.lower_from_lift(s.layer, s.next, s.mask, {}) : stay();
          },
          [&](const Draining& s, const MaskLoaded& e) { return with_mask(s, e, b); },
          [&](const Draining& s, const PauseAsked&) { return b.pause_on_top(s); },
          [&](const Draining& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Retreating& s, const MoveDone& e) { return e.move == s.move ? b.to(Paused{s.next}) : stay(); },
          [&](const Retreating& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Paused& s, const ResumeAsked&) { return b.home_for(s.next, {}); },
          [&](const Paused& s, const CancelAsked&) { return b.cancel(s.next); },

          [&](const Finishing& s, const MoveDone& e) {
            if (e.move != s.move) return stay();
            return b.to(Done{s.printed}, {WriteJournal{JournalStep::Finished, s.printed, {}, {}}});
          },
          [&](const Cancelling& s, const MoveDone& e) { return e.move == s.move ? b.cancelled(s.next) : stay(); },

          [&](const Faulted& s, const ResumeAsked&) { return b.from_fault(s); },
          [&](const Faulted& s, const RetryAsked&) { return b.from_fault(s); },
          [&](const Faulted& s, const CancelAsked&) { return b.cancelled(s.next); },

          [&](const auto&, const auto&) { return stay(); },
      },
      state, event);
}

}  // namespace

Step next(const PrintPlan& plan, const PrintState& state, const PrintEvent& event, Ticket last_ticket) {
  Step step = transition(plan, state, event, last_ticket);
  if (auto word = word_of(state, event)) {
    // Kept once the light is off and the stage at rest, and before anything moves or ends on it.
    const auto moves_on = std::find_if_not(step.commands.begin(), step.commands.end(), [](const PrintCommand& c) {
      return std::holds_alternative<LightOff>(c) || std::holds_alternative<HoldStage>(c);
    });
    step.commands.insert(moves_on, std::move(*word));
  }
  return step;
}

bool may_be_lit(const PrintState& state) { return std::holds_alternative<Exposing>(state); }

bool may_move(const PrintState& state) {
  return std::visit(
      [](const auto& s) {
        return requires { s.move; };
      },
      state);
}

bool is_final(const PrintState& state) {
  return std::holds_alternative<Done>(state) || std::holds_alternative<Cancelled>(state);
}

LayerIndex layer_of(const PrintState& state) {
  return std::visit(overloaded{[](const Idle&) { return LayerIndex{}; },
                               [](const auto& s) {
                                 if constexpr (requires { s.next; })
                                   return s.next;
                                 else if constexpr (requires { s.layer; })
                                   return s.layer;
                                 else
                                   return s.printed;
                               }},
                    state);
}

PrintPhase phase_of(const PrintState& state) {
  static_assert(std::variant_size_v<PrintState> == static_cast<std::size_t>(PrintPhase::Faulted) + 1);
  static_assert(
      std::is_same_v<std::variant_alternative_t<static_cast<std::size_t>(PrintPhase::Paused), PrintState>, Paused>);
  return static_cast<PrintPhase>(state.index());
}

std::string_view name_of(PrintPhase phase) {
  static constexpr std::string_view names[] = {
      "idle",      "awaiting-decision", "homing",  "lowering",  "settling",   "exposing",
      "resting",   "tilting",           "lifting", "draining",  "retreating", "paused",
      "finishing", "cancelling",        "done",    "cancelled", "faulted"};
  static_assert(std::size(names) == std::variant_size_v<PrintState>);
  return names[static_cast<std::size_t>(phase)];
}

std::string_view name_of(const PrintState& state) { return name_of(phase_of(state)); }

std::string_view name_of(Decision decision) {
  static constexpr std::string_view names[] = {"expose-again", "treat-as-exposed", "give-up"};
  return names[static_cast<std::size_t>(decision)];
}

std::string_view name_of(JournalStep step) {
  static constexpr std::string_view names[] = {
      "planned",     "ready",         "exposing",        "not-exposed", "exposed", "lifted",
      "passed",      "decided-again", "decided-exposed", "finished",    "stopped", "approved",
      "pause-asked", "resumed",       "cancel-asked",    "cancelled",   "faulted", "set-aside"};
  static_assert(std::size(names) == kJournalSteps);
  return names[static_cast<std::size_t>(step)];
}

}  // namespace telefab::fab
