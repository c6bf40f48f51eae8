// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <mutex>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/base/digest.hpp>
#include <vector>

namespace telefab::fab {

/// One time the light was on. Times are Clock::now().
struct LitSpan {
  Nanoseconds from{};
  Nanoseconds until{};
  Digest mask;       ///< SHA-256 of the grey bytes shown
  double z_mm = 0;   ///< gap while lit
  double share = 1;  ///< of full light; of a DLPC900, of its largest LED current
  friend bool operator==(const LitSpan&, const LitSpan&) = default;
};

/// One time the platform was in motion.
struct MoveSpan {
  Nanoseconds from{};
  Nanoseconds until{};
  double z_from_mm = 0;
  double z_to_mm = 0;
  friend bool operator==(const MoveSpan&, const MoveSpan&) = default;
};

/// What a simulated machine really did, as a recorder beside it would have written it down. Virtual devices and device
/// models write it, tests and `report` read it. Threads: all methods may be called from several threads.
class MachineLog {
 public:
  void lit(const LitSpan& span);
  void moved(const MoveSpan& span);
  [[nodiscard]] std::vector<LitSpan> light() const;
  [[nodiscard]] std::vector<MoveSpan> moves() const;
  /// Where the platform is now, as far as the recorder knows.
  [[nodiscard]] double z_mm() const;
  /// Summed time of light and motion at once; zero on a safe machine.
  [[nodiscard]] Nanoseconds light_while_moving() const;

 private:
  mutable std::mutex mutex_;
  std::vector<LitSpan> light_;
  std::vector<MoveSpan> moves_;
};

}  // namespace telefab::fab
