// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <variant>
#include <vector>

namespace telefab::fab {

/// Names one move, one loading, one wait or one exposure. A reply with an old ticket changes nothing.
enum class Ticket : std::uint64_t {};

/// What to do about a layer that was perhaps exposed already.
enum class Decision : std::uint8_t {
  ExposeAgain,     ///< it was not, or a double dose does less harm than none
  TreatAsExposed,  ///< it was; go on with the next one
  GiveUp,          ///< end the print
};
[[nodiscard]] std::string_view name_of(Decision decision);

/// What follows an exposure that was not asked to end early.
enum class AfterExposure : std::uint8_t { GoOn, Pause, Stop };

/// Where a print begins or goes on: taken from the journal.
struct ResumePoint {
  LayerIndex next;             ///< first layer not known to be exposed
  bool maybe_exposed = false;  ///< `next` was about to be exposed when the record broke off, or the record is damaged
  std::uint32_t in_question = 1;  ///< maybe_exposed only: layers from `next` on that were perhaps exposed
  friend bool operator==(const ResumePoint&, const ResumePoint&) = default;
};

// ---- states: each holds exactly what it knows ----------------------------------------------------------------------

/// Loading of the coming layer's mask, which goes on during any motion.
struct Loading {
  Ticket ticket{};
  bool done = false;
};

struct Idle {};
struct AwaitingDecision {
  LayerIndex layer;
  std::uint32_t in_question = 1;
};  ///< dark; so many layers from `layer` on were perhaps exposed
struct Homing {
  LayerIndex next;
  Ticket move{};
  bool pause_after = false;
};
struct Lowering {
  LayerIndex layer;
  Ticket move{};
  Loading mask;
  bool pause_after = false;
};
struct Settling {
  LayerIndex layer;
  Ticket timer{};
  Loading mask;
  bool settled = false;
};
struct Exposing {
  LayerIndex layer;
  Ticket exposure{};
  AfterExposure after = AfterExposure::GoOn;
};
/// Dark and at rest on the vat, so that what was lit last grows firm.
struct Resting {
  LayerIndex layer;
  LayerIndex next;
  Ticket timer{};
  Loading mask;
  bool pause_after = false;
};
/// The vat tips down and up again.
struct Tilting {
  LayerIndex layer;
  LayerIndex next;
  Ticket move{};
  Loading mask;
  bool pause_after = false;
};
struct Lifting {
  LayerIndex layer;
  LayerIndex next;
  Ticket move{};
  Loading mask;
  bool pause_after = false;
};
/// At rest on top of the lift: resin flows back.
struct Draining {
  LayerIndex layer;
  LayerIndex next;
  Ticket timer{};
  Loading mask;
};
struct Retreating {
  LayerIndex next;
  Ticket move{};
};  ///< lifting to pause
struct Paused {
  LayerIndex next;
};  ///< lifted off the vat, homed, dark
struct Finishing {
  LayerIndex printed;
  Ticket move{};
};  ///< raising the finished part
struct Cancelling {
  LayerIndex next;
  Ticket move{};
};  ///< raising what there is
struct Done {
  LayerIndex printed;
};
struct Cancelled {
  LayerIndex next;
};
/// Dark, at rest, position unknown. ResumeAsked and RetryAsked home and go on.
struct Faulted {
  LayerIndex next;
  bool maybe_exposed = false;
  Error cause;
};

using PrintState = std::variant<Idle, AwaitingDecision, Homing, Lowering, Settling, Exposing, Resting, Tilting, Lifting,
                                Draining, Retreating, Paused, Finishing, Cancelling, Done, Cancelled, Faulted>;

/// Which of the states; a row of theirs, in their order.
enum class PrintPhase : std::uint8_t {
  Idle,
  AwaitingDecision,
  Homing,
  Lowering,
  Settling,
  Exposing,
  Resting,
  Tilting,
  Lifting,
  Draining,
  Retreating,
  Paused,
  Finishing,
  Cancelling,
  Done,
  Cancelled,
  Faulted,
};
[[nodiscard]] PrintPhase phase_of(const PrintState& state);
/// One word with hyphens: "awaiting-decision".
[[nodiscard]] std::string_view name_of(PrintPhase phase);

// ---- events --------------------------------------------------------------------------------------------------------

struct StartAsked {
  ResumePoint from;
};
struct MoveDone {
  Ticket move{};
};  ///< the stage is at rest where it was sent, or the vat tipped and back
struct MaskLoaded {
  Ticket mask{};
};
struct TimerDone {
  Ticket timer{};
};
struct ExposureDone {
  Ticket exposure{};
};  ///< the device said so; the light is off
struct ExposureRefused {
  Ticket exposure{};
  Error cause;
};  ///< certain: no light was shown
struct DeviceFailed {
  Error cause;
};  ///< also: the journal could not be written
struct InterlockOpened {};
/// The resin is outside its limits.
struct WrongTemperature {
  double celsius = 0;
  bool is_hot = false;  ///< else cold
};
/// Words of an operator, each journalled before anything moves on it; `by` is the operator's name.
struct PauseAsked {
  std::string by;
};
struct ResumeAsked {
  std::string by;
};
struct CancelAsked {
  std::string by;
};
/// The fence gave no leave for the exposure; the light was never on for it. The print ends as at an orderly stop.
struct LeaveRefused {
  Ticket exposure{};
  Error cause;
};
/// The runner's own answer to a fault with the light certainly off; nobody's word.
struct RetryAsked {};
struct DecisionMade {
  Decision decision{};
  std::string by;  ///< who decided, for the journal and the record: "policy", or the operator's name
};
/// The site ends. The print is left dark, at rest and resumable (Faulted, its cause Cancelled).
struct StopAsked {
  bool let_exposure_end = false;  ///< false: dark at once; a layer under way was then perhaps exposed
};

using PrintEvent = std::variant<StartAsked, MoveDone, MaskLoaded, TimerDone, ExposureDone, ExposureRefused,
                                DeviceFailed, InterlockOpened, WrongTemperature, PauseAsked, ResumeAsked, CancelAsked,
                                LeaveRefused, RetryAsked, DecisionMade, StopAsked>;

// ---- commands, carried out in order; one that fails drops those behind it and becomes DeviceFailed
// -------------------

/// What the journal says about a layer, in the order of a print.
enum class JournalStep : std::uint8_t {
  Planned,     ///< once, first line: the plan's digest
  Ready,       ///< mask loaded, platform at rest
  Exposing,    ///< synced before the light goes on
  NotExposed,  ///< the exposure announced last was certainly not made
  Exposed,     ///< synced before anything moves
  Lifted,
  Passed,                 ///< empty layer: no light
  DecidedExposeAgain,     ///< maybe exposed: will be exposed again
  DecidedTreatAsExposed,  ///< maybe exposed: counts as exposed
  Finished,  ///< every layer made and the part raised; a print that broke off before is raised at its resumption
  Stopped,   ///< an orderly stop of the site, or no leave to light; `layer` is the next one. Absent after a crash
  // Words of operators, synced before the command is answered; `by` says whose.
  Approved,     ///< may begin; `by` is "automatic" where the site's policy starts every job
  PauseAsked,   ///< no further exposure until Resumed
  Resumed,      ///< goes on
  CancelAsked,  ///< never another exposure
  Cancelled,    ///< ended so
  Faulted,      ///< went dark and held by itself; `why` is the cause
  SetAside,     ///< what was damaged in this journal lies beside it; `why` says what is missing
};
/// Of JournalStep.
inline constexpr int kJournalSteps = static_cast<int>(JournalStep::SetAside) + 1;

struct LightOff {};
struct HoldStage {};
struct GoHome {
  Ticket move{};
};
/// Along all legs, of which there is at least one.
struct MoveAlong {
  Ticket move{};
  std::vector<StageLeg> legs;
};
struct Tilt {
  Ticket move{};
  Nanoseconds duration{};
};
struct LoadMask {
  Ticket mask{};
  LayerIndex layer;
};
struct StartTimer {
  Ticket timer{};
  Nanoseconds duration{};
};
struct Expose {
  Ticket exposure{};
  LayerIndex layer;
};
struct WriteJournal {
  JournalStep step{};
  LayerIndex layer;
  std::string by;   ///< Decided* and operators' words: whose
  std::string why;  ///< Faulted only: the cause
};

using PrintCommand =
    std::variant<LightOff, HoldStage, GoHome, MoveAlong, Tilt, LoadMask, StartTimer, Expose, WriteJournal>;

struct Step {
  PrintState state;
  std::vector<PrintCommand> commands;
  Ticket last_ticket{};
};

/// The whole print logic: same arguments, same Step. `plan` is valid. No clock, no device, no file.
[[nodiscard]] Step next(const PrintPlan& plan, const PrintState& state, const PrintEvent& event, Ticket last_ticket);

[[nodiscard]] bool may_be_lit(const PrintState& state);  ///< true in Exposing only
[[nodiscard]] bool may_move(const PrintState& state);    ///< the platform or the vat may be in motion
[[nodiscard]] bool is_final(const PrintState& state);    ///< Done, Cancelled
[[nodiscard]] std::string_view name_of(const PrintState& state);
[[nodiscard]] std::string_view name_of(JournalStep step);
/// The layer the state is about: the next one to expose, or the number printed in Done.
[[nodiscard]] LayerIndex layer_of(const PrintState& state);

}  // namespace telefab::fab
