// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/service/live_counters.hpp>
#include <utility>

namespace telefab {

void LiveCounters::begin(const std::string& job, const JobCounters& counters) {
  const auto [slot, is_new] = jobs_.try_emplace(job, Live{counters});
  if (!is_new && slot->second.is_over) slot->second = Live{counters};
}

void LiveCounters::keep() {
  bool is_whole = true;
  for (auto each = jobs_.begin(); each != jobs_.end();) {
    Live& live = each->second;
    if (live.is_dirty) live.is_dirty = !store_(each->first, live.counters);
    is_whole &= !live.is_dirty;
    each = live.is_over && !live.is_dirty ? jobs_.erase(each) : std::next(each);
  }
  if (!is_whole) keep_after(kRetryAfter);
}

void LiveCounters::end(const std::string& job) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return;
  found->second.is_over = true;
  keep();
}

std::vector<std::string> LiveCounters::jobs() const {
  std::vector<std::string> names;
  for (const auto& [job, live] : jobs_)
    if (!live.is_over) names.push_back(job);
  return names;
}

void LiveCounters::keep_after(Nanoseconds pause) {
  if (std::exchange(is_keeping_soon_, true)) return;
  loop_.after(pause, [this, alive = std::weak_ptr<bool>{alive_}] {
    if (alive.expired()) return;
    is_keeping_soon_ = false;
    keep();
  });
}

}  // namespace telefab
