// SPDX-License-Identifier: GPL-3.0-or-later
#include <systemd/sd-daemon.h>

#include <algorithm>
#include <telefab/service/service_notifier.hpp>

namespace telefab {

void ServiceNotifier::begin(net::Loop& loop, std::function<bool()> is_alive) {
  loop_ = &loop;
  is_alive_ = std::move(is_alive);
  (void)::sd_notify(0, "READY=1");
  std::uint64_t period_us = 0;
  if (::sd_watchdog_enabled(0, &period_us) <= 0) return;
  every_ = std::chrono::milliseconds{std::max<std::uint64_t>(period_us / 3000, 1)};
  feed();
}

void ServiceNotifier::feed() {
  if (is_alive_()) (void)::sd_notify(0, "WATCHDOG=1");
  loop_->after(every_, [this] { feed(); });
}

void ServiceNotifier::end() { (void)::sd_notify(0, "STOPPING=1"); }

bool Heartbeat::is_alive(std::optional<std::uint64_t> beats, Nanoseconds now) {
  if (!beats || beats != last_) {
    last_ = beats;
    since_ = now;
    return true;
  }
  return now - since_ <= longest_;
}

}  // namespace telefab
