// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/service/live_counters.hpp>
#include <utility>

namespace telefab {
namespace {

constexpr auto kKeepAfter = std::chrono::milliseconds{100};

}  // namespace

void LiveCounters::keep() {
  for (auto& [job, live] : jobs_)
    if (std::exchange(live.is_dirty, false)) store_(job, live.counters);
}

void LiveCounters::end(const std::string& job) {
  keep();
  jobs_.erase(job);
}

std::vector<std::string> LiveCounters::jobs() const {
  std::vector<std::string> names;
  for (const auto& [job, live] : jobs_) names.push_back(job);
  return names;
}

void LiveCounters::keep_soon() {
  if (std::exchange(is_keeping_soon_, true)) return;
  loop_.after(kKeepAfter, [this, alive = std::weak_ptr<bool>{alive_}] {
    if (alive.expired()) return;
    is_keeping_soon_ = false;
    keep();
  });
}

}  // namespace telefab
