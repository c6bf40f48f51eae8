// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/drivers/model_lamp.hpp>
#include <utility>

namespace telefab::fab {

void ModelLamp::set(double share, Nanoseconds at) {
  if (share == share_) return;
  const Nanoseconds from = std::exchange(from_, at);
  const double was = std::exchange(share_, share);
  if (was <= 0 || at <= from) return;
  sum_ += at - from;
  if (log_ != nullptr) log_->lit({from, at, {}, log_->z_mm(), was});
}

}  // namespace telefab::fab
