// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/fab/print/printer_journal.hpp>

namespace telefab::fab {

// What may light when the site starts: whose word, how old, after which stop. The whole rule, and nothing else decides.

/// What is known of a print that has not ended, from its journal, its plan and the job store.
struct StartFacts {
  StandingOrder order;
  bool is_finished = false;     ///< every layer made and the part raised
  bool has_faulted = false;     ///< the journal ends with a fault
  bool is_of_this_plan = true;  ///< the journal belongs to the plan that lies beside it
  bool is_damaged = false;
  /// The store has seen layers of which the journal knows nothing: an older journal was put in its place.
  bool is_behind_store = false;
  /// The store knows of no print although the journal does: an older store was put in its place.
  bool is_ahead_of_store = false;
  bool maybe_exposed = false;  ///< layers are in question
  bool is_at_printer =
      false;  ///< a whole printer was asked to start it, and it is not over: the light is the printer's
  bool is_paused_in_store = false;  ///< it waited for an operator when the site ended
  Nanoseconds last_sign{};          ///< wall time of the newest line of the journal; 0: it is empty
};

/// What an operator allows a start to do by itself.
struct StartPolicy {
  bool go_on = true;  ///< false: every print waits for `resume`
  /// A print goes on by itself when its journal is at most so old. A part that hung in the vat for longer may have
  /// sagged or dried, and somebody may have opened the machine.
  Nanoseconds within = std::chrono::minutes{10};
  /// For layers in question; empty: they wait for an operator.
  std::optional<Decision> maybe_exposed;
};

enum class StartRuling : std::uint8_t {
  GoOn,             ///< may light by itself
  WaitForApproval,  ///< has not begun; waits for `approve`
  WaitForResume,    ///< waits for `resume`
  WaitForDecision,  ///< waits for `resume`, with a word about the layers in question
  End,              ///< cancelled: never lights again
  KeepRecord,       ///< finished: no light, no motion
  Watch,            ///< goes on at its printer whatever is done here; nothing is started
};
enum class StartReason : std::uint8_t {
  LivingOrder,
  Cancelled,
  Finished,
  OtherPlan,
  Damaged,
  BehindStore,
  AheadOfStore,
  PerhapsExposed,
  Paused,
  NoOrder,
  Faulted,
  AlwaysAsk,
  ClockWentBack,
  TooOld,
};
struct StartVerdict {
  StartRuling ruling = StartRuling::WaitForResume;
  StartReason reason = StartReason::NoOrder;
  friend bool operator==(const StartVerdict&, const StartVerdict&) = default;
};

/// The rule. `begun`: the print has been on its machine before; `wall`: the time now. Pure.
[[nodiscard]] StartVerdict may_light_at_start(const StartFacts& facts, bool begun, const StartPolicy& policy,
                                              Nanoseconds wall);
[[nodiscard]] std::string_view name_of(StartRuling ruling);
[[nodiscard]] std::string_view name_of(StartReason reason);
/// Why a job waits, for people; empty for rulings that wait for nobody.
[[nodiscard]] std::string sentence_of(const StartVerdict& verdict);

/// The facts as a journal tells them, `layers_in_store` and `is_paused_in_store` as the store does. `plan`: the digest
/// of the plan beside the journal.
[[nodiscard]] StartFacts facts_of(const PrintJournal& journal, const Digest& plan, LayerIndex layers_in_store,
                                  bool is_begun_in_store, bool is_paused_in_store);
/// The same of a print on a whole printer; `orders`: the journal beside it that keeps operators' words. `journal` null:
/// it is damaged.
[[nodiscard]] StartFacts facts_of(const PrinterJournal* journal, const PrintJournal& orders, const Digest& plan,
                                  LayerIndex layers_in_store, bool is_begun_in_store, bool is_paused_in_store);
/// Layers in question by the journal and by what the store has seen.
[[nodiscard]] ResumePoint resume_point_of(const PrintJournal& journal, LayerIndex layers_in_store);

}  // namespace telefab::fab
