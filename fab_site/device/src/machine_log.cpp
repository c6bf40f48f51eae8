// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/device/machine_log.hpp>

namespace telefab::fab {

void MachineLog::lit(const LitSpan& span) {
  const std::lock_guard lock{mutex_};
  light_.push_back(span);
}

void MachineLog::moved(const MoveSpan& span) {
  const std::lock_guard lock{mutex_};
  moves_.push_back(span);
}

std::vector<LitSpan> MachineLog::light() const {
  const std::lock_guard lock{mutex_};
  return light_;
}

std::vector<MoveSpan> MachineLog::moves() const {
  const std::lock_guard lock{mutex_};
  return moves_;
}

double MachineLog::z_mm() const {
  const std::lock_guard lock{mutex_};
  return moves_.empty() ? 0 : moves_.back().z_to_mm;
}

Nanoseconds MachineLog::light_while_moving() const {
  const std::lock_guard lock{mutex_};
  // Both lists are in order of time and without overlap in themselves: one sweep.
  Nanoseconds both{};
  auto move = moves_.begin();
  for (const LitSpan& lit : light_) {
    while (move != moves_.end() && move->until <= lit.from) ++move;
    for (auto m = move; m != moves_.end() && m->from < lit.until; ++m)
      both += std::max(Nanoseconds{}, std::min(lit.until, m->until) - std::max(lit.from, m->from));
  }
  return both;
}

}  // namespace telefab::fab
