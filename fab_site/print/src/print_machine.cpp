// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
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
  [[nodiscard]] Step lower_to(LayerIndex layer, Commands commands, Loading mask) {
    if (mask.ticket == Ticket{}) {
      mask.ticket = fresh();
      commands.emplace_back(LoadMask{mask.ticket, layer});
    }
    const Ticket move = fresh();
    commands.emplace_back(MoveTo{move, at(layer).z_mm, plan_.motion.lower_speed_mm_per_s});
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

  /// Peel off after layer; the mask of the next one loads meanwhile.
  [[nodiscard]] Step lift_from(const Exposing& s) {
    Commands commands{LightOff{}, WriteJournal{JournalStep::Exposed, s.layer, {}, {}}};
    const LayerIndex next = pass_empty(s.layer + LayerIndex{1}, commands);
    if (s.after == AfterExposure::Stop) return stopped(next, false, std::move(commands));
    const bool pause = s.after == AfterExposure::Pause;
    Lifting lifting{s.layer, next, fresh(), {}, pause};
    commands.emplace_back(
        MoveTo{lifting.move, at(s.layer).z_mm + plan_.motion.lift_mm, plan_.motion.lift_speed_mm_per_s});
    if (!past_end(next) && !pause) {
      lifting.mask.ticket = fresh();
      commands.emplace_back(LoadMask{lifting.mask.ticket, next});
    }
    return to(lifting, std::move(commands));
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
    const auto rest = Nanoseconds{static_cast<Nanoseconds::rep>(plan_.motion.settle_s * 1e9)};
    return to(Settling{s.layer, timer, s.mask, false}, {StartTimer{timer, rest}});
  }

  [[nodiscard]] Step retreat(LayerIndex layer) {
    const Ticket move = fresh();
    return to(Retreating{layer, move},
              {LightOff{}, MoveTo{move, at(layer).z_mm + plan_.motion.lift_mm, plan_.motion.lift_speed_mm_per_s}});
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
            return b.lower_to(s.next, {}, {});
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
          [&](const Exposing& s, const ExposureDone& e) { return e.exposure == s.exposure ? b.lift_from(s) : stay(); },
          [&](const Exposing& s, const ExposureRefused& e) {
            if (e.exposure != s.exposure) return stay();
            return b.fault(s.layer, false, e.cause,
                           {LightOff{}, HoldStage{}, WriteJournal{JournalStep::NotExposed, s.layer, {}, {}}});
          },
          [&](const Exposing& s, const PauseAsked&) {
            return s.after == AfterExposure::Stop ? stay() : b.to(Exposing{s.layer, s.exposure, AfterExposure::Pause});
          },
          [&](const Exposing& s, const ResumeAsked&) {
            return s.after == AfterExposure::Stop ? stay() : b.to(Exposing{s.layer, s.exposure, AfterExposure::GoOn});
          },
          [&](const Exposing& s, const CancelAsked&) { return b.cancel(s.layer); },

          [&](const Lifting& s, const MoveDone& e) {
            if (e.move != s.move) return stay();
            Commands commands{WriteJournal{JournalStep::Lifted, s.layer, {}, {}}};
            if (b.past_end(s.next)) return b.finish(std::move(commands));
            if (s.pause_after) return b.to(Paused{s.next}, std::move(commands));
            return b.lower_to(s.next, std::move(commands), s.mask);
          },
          [&](const Lifting& s, const MaskLoaded& e) {
            if (e.mask != s.mask.ticket) return stay();
            return b.to(Lifting{s.layer, s.next, s.move, {s.mask.ticket, true}, s.pause_after});
          },
          [&](const Lifting& s, const PauseAsked&) {
            return b.to(Lifting{s.layer, s.next, s.move, s.mask, true});
          },
          [&](const Lifting& s, const ResumeAsked&) {
            return b.to(Lifting{s.layer, s.next, s.move, s.mask, false});
          },
          [&](const Lifting& s, const CancelAsked&) { return b.cancel(s.next); },

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
  return std::visit(overloaded{[](const Idle&) { return LayerIndex{}; }, [](const Lifting& s) { return s.next; },
                               [](const auto& s) {
                                 if constexpr (requires { s.layer; })
                                   return s.layer;
                                 else if constexpr (requires { s.next; })
                                   return s.next;
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
      "idle",   "awaiting-decision", "homing",     "lowering", "settling",  "exposing", "lifting", "retreating",
      "paused", "finishing",         "cancelling", "done",     "cancelled", "faulted"};
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
