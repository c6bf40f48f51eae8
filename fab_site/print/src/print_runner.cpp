// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <utility>

namespace telefab::fab {

namespace {

using namespace std::chrono_literals;

template <class... F>
struct overloaded : F... {
  using F::operator()...;
};
template <class... F>
overloaded(F...) -> overloaded<F...>;

constexpr int kDarkTries = 5;
constexpr Nanoseconds kLoadGrace = 20s;
constexpr Nanoseconds kSurelyUndivided = 15s;  // below what any supported controller times at once (DLPC900: 16.7 s)
constexpr Nanoseconds kExposureGrace = 1s;

/// One run of a print: what the machine waits for, and the replies.
class Run {
 public:
  Run(Projector& projector, ZStage& stage, MaskSource& masks, PrintJournal& journal, Clock& clock, Sensors* sensors,
      LightFence* fence, const PrintPlan& plan, const PrintPolicy& policy, PrintControl& control, const PrintSink& sink)
      : projector_{projector},
        stage_{stage},
        masks_{masks},
        journal_{journal},
        clock_{clock},
        sensors_{sensors},
        fence_{fence},
        plan_{plan},
        policy_{policy},
        control_{control},
        sink_{sink},
        recoveries_{policy.recoveries},
        left_{time_left(plan, {stage.facts().highest_mm, stage.facts().homing_mm_per_s})} {}

  /// Until final, or faulted with nothing left to try.
  void print(std::stop_token stop) {
    stop_ = std::move(stop);
    feed(StartAsked{journal_.resume_point()});
    while (!is_final(state_)) {
      if (stop_.stop_requested() && !std::exchange(stopping_, true)) {
        feed(StopAsked{exposure_ && exposure_->due - clock_.now() <= policy_.longest_last_light});
        continue;
      }
      if (const auto* faulted = std::get_if<Faulted>(&state_)) {
        // A word that came with the fault is heard before anything is tried again.
        if (take_word()) continue;
        if (!may_recover(*faulted)) return;
        --recoveries_;
        ++retries_;
        feed(RetryAsked{});
        continue;
      }
      if (std::holds_alternative<AwaitingDecision>(state_)) {
        // A word of the operator that came first counts more than the policy.
        if (take_word()) continue;
        if (policy_.maybe_exposed && is_allowed()) {
          feed(DecisionMade{*policy_.maybe_exposed, "policy"});
          continue;
        }
      }
      if (take_word()) continue;
      if (auto event = observe())
        feed(*event);
      else
        clock_.sleep_for(wait());
    }
  }

  /// Hears the oldest word of an operator, and answers it once the journal has it. False: there is none.
  bool take_word() {
    auto wish = control_.take();
    if (!wish) return false;
    unkept_.reset();
    feed(wish->event);
    if (!wish->kept) return true;
    if (unkept_)
      wish->kept(Result<void>{tl::unexpected{*unkept_}});
    else
      wish->kept(Result<void>{});
    return true;
  }

  [[nodiscard]] const PrintState& state() const { return state_; }
  [[nodiscard]] const std::string& alarm() const { return alarm_; }
  /// Why the print ended without leave to light; None: it did not.
  [[nodiscard]] FenceRefusal withheld() const { return withheld_; }

  /// The light off, whatever it takes. Returns whether the device confirmed it.
  [[nodiscard]] bool go_dark() {
    for (int i = 0; i < kDarkTries; ++i) {
      const auto dark = projector_.dark();
      if (dark) {
        alarm_.clear();
        return true;
      }
      alarm_ = "THE LIGHT MAY STILL BE ON, switch the projector off: " + dark.error().what;
      clock_.sleep_for(policy_.poll);
    }
    return false;
  }

 private:
  [[nodiscard]] bool may_recover(const Faulted& faulted) const {
    return !stopping_ && recoveries_ > 0 && alarm_.empty() && is_device_fault(faulted.cause.code) && is_allowed() &&
           (!faulted.maybe_exposed || policy_.maybe_exposed);
  }

  /// No operator's word stands against going on.
  [[nodiscard]] bool is_allowed() const {
    const Order order = journal_.order().order;
    return order != Order::Pause && order != Order::Cancel;
  }

  void feed(const PrintEvent& first) {
    std::deque<PrintEvent> events{first};
    while (!events.empty()) {
      Step step = next(plan_, state_, events.front(), last_);
      events.pop_front();
      const bool changed = step.state.index() != state_.index() || layer_of(step.state) != layer_of(state_);
      state_ = std::move(step.state);
      last_ = step.last_ticket;
      for (const PrintCommand& command : step.commands) {
        if (auto failed = carry_out(command)) {
          events.push_back(std::move(*failed));
          if (!std::holds_alternative<LightOff>(command) && !std::holds_alternative<HoldStage>(command)) break;
        }
      }
      if (changed) report_progress();
    }
  }

  void report_progress() const {
    if (!sink_) return;
    const LayerIndex layer = layer_of(state_);
    std::string message = alarm_;
    if (const auto* f = std::get_if<Faulted>(&state_)) message += (message.empty() ? "" : "; ") + f->cause.what;
    if (std::holds_alternative<AwaitingDecision>(state_))
      message = fmt::format("layer {} was perhaps exposed: decide whether to expose it again", layer.count());
    const auto count = static_cast<std::uint32_t>(plan_.layers.size());
    sink_({phase_of(state_), layer, LayerIndex{count}, z_mm_, left_[std::min(layer.count(), count)], message,
           resin_celsius_});
  }

  [[nodiscard]] std::optional<PrintEvent> carry_out(const PrintCommand& command) {
    const auto check = [](const Result<void>& r) -> std::optional<PrintEvent> {
      if (r) return std::nullopt;
      return DeviceFailed{r.error()};
    };
    return std::visit(overloaded{
                          [&](const LightOff&) -> std::optional<PrintEvent> {
                            load_.reset();
                            exposure_.reset();
                            if (go_dark()) return std::nullopt;
                            return DeviceFailed{{ErrorCode::DeviceLost, alarm_}};
                          },
                          [&](const HoldStage&) {
                            move_.reset();
                            timer_.reset();
                            return check(stage_.hold());
                          },
                          [&](const GoHome& c) {
                            move_ = {c.move, Nanoseconds{}};
                            return check(stage_.home());
                          },
                          [&](const MoveAlong& c) {
                            move_ = {c.move, clock_.now() + path_time(z_mm_, c.legs, plan_.acceleration_mm_per_s2)};
                            return check(stage_.move_along(c.legs));
                          },
                          [&](const Tilt& c) {
                            move_ = {c.move, clock_.now() + c.duration};
                            return check(stage_.tilt(c.duration));
                          },
                          [&](const LoadMask& c) { return load(c); },
                          [&](const StartTimer& c) -> std::optional<PrintEvent> {
                            timer_ = {c.timer, clock_.now() + c.duration};
                            return std::nullopt;
                          },
                          [&](const Expose& c) { return expose(c); },
                          [&](const WriteJournal& c) { return write(c); },
                      },
                      command);
  }

  [[nodiscard]] std::optional<PrintEvent> load(const LoadMask& c) {
    const auto mask = masks_.mask(c.layer);
    if (!mask)
      return DeviceFailed{{mask.error().code, fmt::format("mask of layer {}: {}", c.layer.count(), mask.error().what)}};
    const PlannedLayer& planned = plan_.layers[c.layer.count()];
    if (digest_of(std::as_bytes(std::span{mask->rows})) != planned.mask)
      return DeviceFailed{
          {ErrorCode::NotTrusted,
           fmt::format("the mask of layer {} is not the planned one: its digest differs", c.layer.count())}};
    if (const auto ok = projector_.load(mask->view(), {planned.exposure, planned.light_share}); !ok)
      return DeviceFailed{ok.error()};
    load_ = {c.mask, clock_.now() + projector_.load_time(mask->view()) * 4 + kLoadGrace};
    return std::nullopt;
  }

  /// Dark and at rest; nothing of the layer is in the journal yet. Nothing: it may be lit.
  [[nodiscard]] std::optional<PrintEvent> await_leave(Ticket exposure, LayerIndex layer) {
    if (fence_ == nullptr) return std::nullopt;
    const Nanoseconds due = clock_.now() + policy_.longest_leave;
    while (true) {
      const Leave leave = fence_->leave(layer);
      if (leave.state == LeaveState::Given) {
        withheld_ = FenceRefusal::None;
        return std::nullopt;
      }
      if (leave.state == LeaveState::Refused || stop_.stop_requested() || clock_.now() >= due)
        return without_leave(exposure, layer, leave);
      clock_.sleep_for(policy_.poll);
    }
  }

  [[nodiscard]] PrintEvent without_leave(Ticket exposure, LayerIndex layer, const Leave& leave) {
    withheld_ = leave.state == LeaveState::Awaited ? FenceRefusal::Unanswered : leave.why;
    return LeaveRefused{exposure,
                        {ErrorCode::Conflict, fmt::format("layer {} is not exposed: {}", layer.count(), leave.what)}};
  }

  [[nodiscard]] std::optional<PrintEvent> expose(const Expose& c) {
    // The line in the journal took its time; whatever happened meanwhile counts.
    if (fence_ != nullptr)
      if (const Leave leave = fence_->leave(c.layer); leave.state != LeaveState::Given)
        return without_leave(c.exposure, c.layer, leave);
    const Microseconds duration = plan_.layers[c.layer.count()].exposure;
    made_ = {};
    made_.started_wall = clock_.wall();
    const auto lit = projector_.expose();
    if (!lit) {
      const ErrorCode code = lit.error().code;
      const bool surely_dark =
          code == ErrorCode::DeviceRefused || code == ErrorCode::Conflict || code == ErrorCode::InvalidInput;
      if (surely_dark) return ExposureRefused{c.exposure, lit.error()};
      return DeviceFailed{lit.error()};
    }
    exposure_ = {c.exposure, clock_.now() + Nanoseconds{duration}};
    return std::nullopt;
  }

  [[nodiscard]] std::optional<PrintEvent> write(const WriteJournal& c) {
    if (const auto* s = std::get_if<Exposing>(&state_); s != nullptr && c.step == JournalStep::Exposing)
      if (auto refused = await_leave(s->exposure, c.layer)) return refused;
    JournalEntry entry{c.step, c.layer, clock_.wall(), {}, c.by, {}, c.why};
    if (fence_ != nullptr && c.step == JournalStep::Exposing) entry.attempt = fence_->attempt();
    if (c.layer.count() < plan_.layers.size()) {
      const PlannedLayer& planned = plan_.layers[c.layer.count()];
      entry.made = c.step == JournalStep::Exposed ? made_ : LayerRecord{};
      entry.made.index = c.layer;
      entry.made.planned = planned.exposure;
      entry.made.mask = planned.mask;
      entry.made.note = c.step;
      if (c.step == JournalStep::Exposed)
        entry.made.z_mm = z_mm_;
      else
        entry.made.z_mm = planned.z_mm;
    }
    if (const auto ok = journal_.write(entry); !ok) {
      unkept_ = ok.error();
      // Before the light goes on nothing has happened yet, and the machine may know it.
      const bool is_before_light = c.step == JournalStep::Ready || c.step == JournalStep::Exposing;
      if (const auto* s = std::get_if<Exposing>(&state_); s != nullptr && is_before_light)
        return ExposureRefused{s->exposure, ok.error()};
      return DeviceFailed{ok.error()};
    }
    return std::nullopt;
  }

  /// The next thing that happened, if something did.
  [[nodiscard]] std::optional<PrintEvent> observe() {
    if (sensors_ != nullptr) {
      const auto reading = sensors_->read();
      if (!reading) return DeviceFailed{reading.error()};
      made_.resin_celsius = resin_celsius_ = reading->resin_celsius;
      if (reading->interlock_open) return InterlockOpened{};
      if (policy_.hottest_celsius && reading->resin_celsius && *reading->resin_celsius > *policy_.hottest_celsius)
        return WrongTemperature{*reading->resin_celsius, true};
      if (policy_.coldest_celsius && reading->resin_celsius && *reading->resin_celsius < *policy_.coldest_celsius)
        return WrongTemperature{*reading->resin_celsius, false};
    }
    if (exposure_) return look_at_exposure();
    if (load_) {
      const auto status = projector_.poll();
      if (!status) return DeviceFailed{status.error()};
      if (status->state == LightState::Loaded) return MaskLoaded{std::exchange(load_, {})->ticket};
      if (clock_.now() > load_->due) return DeviceFailed{{ErrorCode::DeviceTimeout, "the mask was not loaded in time"}};
    }
    if (move_) {
      const auto status = stage_.poll();
      if (!status) {
        move_.reset();
        return DeviceFailed{status.error()};
      }
      if (!status->moving) {
        z_mm_ = status->z_mm;
        return MoveDone{std::exchange(move_, {})->ticket};
      }
    }
    if (timer_ && clock_.now() >= timer_->due) return TimerDone{std::exchange(timer_, {})->ticket};
    return std::nullopt;
  }

  [[nodiscard]] std::optional<PrintEvent> look_at_exposure() {
    const Nanoseconds now = clock_.now();
    const Nanoseconds whole{plan_.layers[layer_of(state_).count()].exposure};
    // A projector that splits a long exposure starts the next part from poll(); a short one ends by itself, and looking
    // at it early could only cut it short.
    if (now < exposure_->due && whole <= kSurelyUndivided) return std::nullopt;
    const auto status = projector_.poll();
    if (!status) return DeviceFailed{status.error()};
    if (status->state == LightState::Exposed) {
      const ExposureReport& r = status->report;
      made_.measured = std::chrono::duration_cast<Microseconds>(r.lit_until - r.lit_from);
      made_.retries = r.retries + std::exchange(retries_, 0u);
      made_.parts = r.parts;
      return ExposureDone{std::exchange(exposure_, {})->ticket};
    }
    const Nanoseconds planned{plan_.layers[layer_of(state_).count()].exposure};
    if (now > exposure_->due + planned / 50 + kExposureGrace)
      return DeviceFailed{{ErrorCode::DeviceTimeout, "the exposure did not end in time"}};
    return std::nullopt;
  }

  /// How long nothing can happen that must be seen at once.
  [[nodiscard]] Nanoseconds wait() const {
    if (load_) return policy_.poll / 10;
    Nanoseconds due = Nanoseconds::max();
    for (const auto& waited : {move_, timer_, exposure_})
      if (waited) due = std::min(due, waited->due);
    return std::clamp(due - clock_.now(), policy_.poll, policy_.slice);
  }

  /// A ticket and when its reply is due; for a load, when it is late.
  struct Waiting {
    Ticket ticket{};
    Nanoseconds due{};
  };

  Projector& projector_;
  ZStage& stage_;
  MaskSource& masks_;
  PrintJournal& journal_;
  Clock& clock_;
  Sensors* sensors_;
  LightFence* fence_;
  const PrintPlan& plan_;
  const PrintPolicy& policy_;
  PrintControl& control_;
  const PrintSink& sink_;
  PrintState state_;
  Ticket last_{};
  std::optional<Waiting> move_, load_, timer_, exposure_;
  LayerRecord made_;
  std::optional<double> resin_celsius_;  ///< last measured
  std::uint32_t retries_ = 0;
  std::uint32_t recoveries_;
  std::stop_token stop_;
  bool stopping_ = false;
  FenceRefusal withheld_ = FenceRefusal::None;
  std::optional<Error> unkept_;  ///< what the journal would not take last
  double z_mm_ = 0;
  std::string alarm_;
  std::vector<Nanoseconds> left_;  ///< when each layer is next
};

}  // namespace

bool is_device_fault(ErrorCode code) {
  return code == ErrorCode::DeviceLost || code == ErrorCode::DeviceTimeout || code == ErrorCode::DeviceRefused;
}

std::optional<PrintControl::Wish> PrintControl::take() {
  const std::lock_guard lock{mutex_};
  if (wishes_.empty()) return std::nullopt;
  Wish wish = std::move(wishes_.front());
  wishes_.pop_front();
  return wish;
}

void PrintControl::ask(PrintEvent event, WordKept kept) {
  {
    const std::lock_guard lock{mutex_};
    if (!is_closed_) {
      wishes_.push_back({std::move(event), std::move(kept)});
      return;
    }
  }
  if (kept) kept(std::nullopt);
}

void PrintControl::close() {
  std::deque<Wish> left;
  {
    const std::lock_guard lock{mutex_};
    is_closed_ = true;
    left.swap(wishes_);
  }
  for (const Wish& wish : left)
    if (wish.kept) wish.kept(std::nullopt);
}

PrintRunner::PrintRunner(Projector& projector, ZStage& stage, MaskSource& masks, PrintJournal& journal, Clock& clock,
                         Sensors* sensors, LightFence* fence)
    : projector_{projector},
      stage_{stage},
      masks_{masks},
      journal_{journal},
      clock_{clock},
      sensors_{sensors},
      fence_{fence} {}

Result<PrintRecord> PrintRunner::run(const PrintPlan& plan, const PrintPolicy& policy, PrintControl& control,
                                     const PrintSink& sink, std::stop_token stop) {
  if (const auto dark = projector_.dark(); !dark)
    return fail_in("switching the light off before the print", dark.error());
  if (const auto ok = plan.validate(); !ok) return tl::unexpected{ok.error()};
  if (policy.poll <= 0ns || policy.slice < policy.poll)
    return fail(ErrorCode::InvalidInput, "the print policy's poll must be positive and its slice not shorter");
  if (plan.mask_size != projector_.facts().size)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the plan's masks have {} x {} pixels, the projector {} x {}", plan.mask_size.width_px,
                    plan.mask_size.height_px, projector_.facts().size.width_px, projector_.facts().size.height_px));
  if (const Microseconds step = projector_.facts().exposure_step; step.count() > 0)
    for (const PlannedLayer& layer : plan.layers)
      if (layer.exposure % step != Microseconds{0})
        return fail(ErrorCode::InvalidInput,
                    fmt::format("layer {} is exposed for {} us, its light is timed in steps of {} us; correct the "
                                "exposures of the profile and plan the job again",
                                layer.index.count(), layer.exposure.count(), step.count()));
  const Digest digest = plan_digest(plan);
  if (const auto ok = journal_.belongs_to(digest); !ok) return tl::unexpected{ok.error()};
  const auto record_of = [&](const PrintState& state) {
    PrintRecord record;
    record.job = plan.job;
    record.machine = plan.machine;
    record.plan = digest;
    record.runs = journal_.runs();
    record.projector = projector_.facts().name;
    record.stage = stage_.facts().name;
    record.layers = journal_.layers();
    record.orders = journal_.orders();
    record.gaps = journal_.gaps();
    record.attempt = journal_.attempt();
    record.next = layer_of(state);
    if (std::holds_alternative<Done>(state)) record.outcome = PrintOutcome::Done;
    // A cancel that was answered stands, even where the platform could not be raised on it.
    const bool is_cancelled = std::holds_alternative<Cancelled>(state) || journal_.order().order == Order::Cancel;
    if (is_cancelled) record.outcome = PrintOutcome::Cancelled;
    if (const auto* faulted = std::get_if<Faulted>(&state)) {
      record.maybe_exposed = faulted->maybe_exposed;
      record.cause = faulted->cause;
    }
    return record;
  };
  // A crash may have come between the end of the print and the keeping of its record.
  if (journal_.finished()) return record_of(Done{LayerIndex{static_cast<std::uint32_t>(plan.layers.size())}});
  const StandingOrder standing = journal_.order();
  if (standing.order == Order::Cancel) return record_of(Cancelled{journal_.resume_point().next});
  if (standing.order == Order::Pause)
    return record_of(Faulted{journal_.resume_point().next,
                             journal_.resume_point().maybe_exposed,
                             {ErrorCode::Cancelled, "paused by " + standing.by}});
  if (const auto ok = journal_.write({JournalStep::Planned,
                                      journal_.resume_point().next,
                                      clock_.wall(),
                                      digest,
                                      {},
                                      {},
                                      {},
                                      fence_ != nullptr ? fence_->attempt() : 0});
      !ok)
    return tl::unexpected{ok.error()};

  Run run{projector_, stage_, masks_, journal_, clock_, sensors_, fence_, plan, policy, control, sink};
  run.print(stop);
  const bool dark = run.go_dark();

  PrintRecord record = record_of(run.state());
  if (record.outcome == PrintOutcome::Faulted) record.withheld = run.withheld();
  if (!dark)
    record.cause = {ErrorCode::DeviceLost, run.alarm() + (record.cause.what.empty() ? "" : "; ") + record.cause.what};
  return record;
}

}  // namespace telefab::fab
