// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/quantity.hpp>

namespace telefab::fab {

// Where a job is one of several fabs' to print, something outside of this one may give it to another. The fence stands
// between that and the light: no layer is lit without its leave (decision 1002).

/// Why a fence gives no leave.
enum class FenceRefusal : std::uint8_t {
  None,
  Superseded,  ///< a newer attempt of the job is known: this one never lights again
  LeaseEnded,  ///< nothing shows that the job is still this machine's; it may be again
  Unanswered,  ///< nobody answered in time; it may be asked again
};
/// "none", "superseded", "lease-ended", "unanswered".
[[nodiscard]] std::string_view name_of(FenceRefusal refusal);

/// What a fence answers.
enum class LeaveState : std::uint8_t {
  Given,    ///< the layer may be lit now
  Awaited,  ///< the question is on its way; to be asked again soon
  Refused,
};
struct Leave {
  LeaveState state = LeaveState::Given;
  FenceRefusal why = FenceRefusal::None;  ///< Refused only
  std::string what;                       ///< Refused: for people; Awaited: what it waits for
};

/// Whether a print may light. Asked for every layer twice: before the journal announces its light, and directly before
/// the light itself. Threads: the print's.
class LightFence {
 public:
  virtual ~LightFence() = default;
  LightFence(const LightFence&) = delete;
  LightFence& operator=(const LightFence&) = delete;

  /// The attempt that this print is of, >= 1, for the journal.
  [[nodiscard]] virtual std::uint32_t attempt() const = 0;
  /// Answers at once.
  [[nodiscard]] virtual Leave leave(LayerIndex layer) = 0;

 protected:
  LightFence() = default;
};

}  // namespace telefab::fab
