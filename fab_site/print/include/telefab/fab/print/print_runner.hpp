// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/device/sensors.hpp>
#include <telefab/fab/device/z_stage.hpp>
#include <telefab/fab/print/light_fence.hpp>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/fab/print/print_machine.hpp>
#include <telefab/fab/print/print_record.hpp>

namespace telefab::fab {

/// Where the masks of a plan come from. Threads: called from the runner's thread only.
class MaskSource {
 public:
  virtual ~MaskSource() = default;
  MaskSource(const MaskSource&) = delete;
  MaskSource& operator=(const MaskSource&) = delete;
  /// The mask of a print layer. The runner compares its digest with the plan's before any light.
  [[nodiscard]] virtual Result<Mask> mask(LayerIndex layer) = 0;

 protected:
  MaskSource() = default;
};

/// What became of an operator's word: it is in the journal and holds, or why it is not; nothing where the print had
/// ended before it took it, so that it is to be kept elsewhere. Called once, on the runner's thread or on that of
/// close().
using WordKept = std::function<void(const std::optional<Result<void>>& outcome)>;

/// The operator's hand on a running print. `by`: who says it, for the journal and the record. Threads: all methods may
/// be called from any thread.
class PrintControl {
 public:
  struct Wish {
    PrintEvent event;
    WordKept kept;
  };
  PrintControl() = default;
  ~PrintControl() { close(); }
  PrintControl(const PrintControl&) = delete;
  PrintControl& operator=(const PrintControl&) = delete;

  void pause(std::string by = {}, WordKept kept = {}) { ask(PauseAsked{std::move(by)}, std::move(kept)); }
  void resume(std::string by = {}, WordKept kept = {}) { ask(ResumeAsked{std::move(by)}, std::move(kept)); }
  void cancel(std::string by = {}, WordKept kept = {}) { ask(CancelAsked{std::move(by)}, std::move(kept)); }
  /// Changes nothing where no layer is in question.
  void decide(Decision decision, std::string by, WordKept kept = {}) {
    ask(DecisionMade{decision, std::move(by)}, std::move(kept));
  }
  void open_interlock() { ask(InterlockOpened{}, {}); }
  /// The oldest wish not yet taken.
  [[nodiscard]] std::optional<Wish> take();
  /// Nobody takes wishes any more: those that wait, and those to come, are told so.
  void close();

 private:
  void ask(PrintEvent event, WordKept kept);
  std::mutex mutex_;
  std::deque<Wish> wishes_;
  bool is_closed_ = false;
};

/// Whether it is something that an operator can put right at the machine; nothing of the print is lost by it.
[[nodiscard]] bool is_device_fault(ErrorCode code);

/// What the print does when nobody is asked.
struct PrintPolicy {
  /// For a layer that was perhaps exposed, unless PrintControl::decide() was called before; empty: wait in
  /// awaiting-decision until it is.
  std::optional<Decision> maybe_exposed;
  /// How often a fault with the light certainly off is answered by homing and trying the layer again; >= 0.
  std::uint32_t recoveries = 2;
  /// Resin warmer than this stops the print; empty: no limit.
  std::optional<double> hottest_celsius;
  std::optional<double> coldest_celsius;  ///< colder resin likewise
  /// A stop request lets an exposure end whose rest is at most this, so that nobody need guess about its layer; a
  /// longer one goes dark at once. Longer than any layer of a usual job, shorter than systemd's TimeoutStopSec.
  Nanoseconds longest_last_light = std::chrono::seconds{60};
  /// Wait between two looks at a device whose answer is due; > 0.
  Nanoseconds poll = std::chrono::milliseconds{10};
  /// Longest wait without a look at the operator's wishes and the sensors; >= poll. Sped-up virtual machines multiply
  /// it by their speed-up.
  Nanoseconds slice = std::chrono::milliseconds{50};
  /// Longest wait for the leave of a fence, dark and at rest, before the print goes back without light; >= 0.
  Nanoseconds longest_leave = std::chrono::seconds{10};
};

/// Told after every change of state, from the runner's thread.
struct PrintProgress {
  PrintPhase phase = PrintPhase::Idle;
  LayerIndex layer;                          ///< next to expose
  LayerIndex layers;                         ///< of the plan
  double z_mm = 0;                           ///< last known
  Nanoseconds left{};                        ///< estimate of what remains
  std::string message;                       ///< for people: the cause in Faulted, the question in AwaitingDecision
  std::optional<double> resin_celsius = {};  ///< last measured, where the machine has a thermometer
};
using PrintSink = std::function<void(const PrintProgress&)>;

/// Carries out what the print machine commands. The devices belong to it while run() goes on. Light off is its first
/// act, its last, and the first act on every fault. Threads: run() on one thread, PrintControl from any.
class PrintRunner {
 public:
  /// All must outlive the runner. `sensors` may be null. `fence`: without whose leave no layer is lit; null: the print
  /// is nobody else's to give away.
  PrintRunner(Projector& projector, ZStage& stage, MaskSource& masks, PrintJournal& journal, Clock& clock,
              Sensors* sensors = nullptr, LightFence* fence = nullptr);

  /// Prints, or goes on where the journal ends, until done, cancelled or faulted beyond recovery; a stop request
  /// lets an exposure under way end (PrintPolicy::longest_last_light), else goes dark and holds at once, and leaves the
  /// print resumable (Faulted, its cause Cancelled). A journal whose standing order is Pause or Cancel is left as it
  /// is: no light, no motion. Without leave to light the print ends dark and resumable, PrintRecord::withheld says why.
  /// Returns the record of what happened, that of a finished print again without light or
  /// motion; fails only when nothing could be begun: InvalidInput (plan), NotTrusted (journal of another plan, or
  /// damaged), Conflict (an older attempt than the journal's), Device* (light could not be switched off).
  [[nodiscard]] Result<PrintRecord> run(const PrintPlan& plan, const PrintPolicy& policy, PrintControl& control,
                                        const PrintSink& sink, std::stop_token stop);

 private:
  Projector& projector_;
  ZStage& stage_;
  MaskSource& masks_;
  PrintJournal& journal_;
  Clock& clock_;
  Sensors* sensors_;
  LightFence* fence_;
};

}  // namespace telefab::fab
