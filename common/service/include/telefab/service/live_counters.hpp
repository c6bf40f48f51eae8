// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <telefab/job/job.hpp>
#include <telefab/net/loop.hpp>
#include <vector>

namespace telefab {

/// The counters of the jobs under way: they change many times a second, and are stored a tenth of a second after the
/// first change that is not, or tried again every second until they are, also those of a job that is over. While
/// nothing changes, nothing runs. Threads: the loop's only.
class LiveCounters {
 public:
  /// Stores the counters of a job; false where that is to be tried again.
  using Keep = std::function<bool(const std::string& job, const JobCounters& counters)>;
  /// The loop must outlive the counters' last change.
  LiveCounters(net::Loop& loop, Keep store) : loop_{loop}, store_{std::move(store)} {}
  ~LiveCounters() { keep(); }
  LiveCounters(const LiveCounters&) = delete;
  LiveCounters& operator=(const LiveCounters&) = delete;

  /// A job goes live with what the store knows of it. One that is live already stays as it is.
  void begin(const std::string& job, const JobCounters& counters);
  [[nodiscard]] bool contains(const std::string& job) const {
    const auto found = jobs_.find(job);
    return found != jobs_.end() && !found->second.is_over;
  }
  /// `change(JobCounters&)`; false, and nothing is called, for a job that is not live.
  template <class Change>
  bool change(const std::string& job, const Change& change) {
    const auto found = jobs_.find(job);
    if (found == jobs_.end() || found->second.is_over) return false;
    change(found->second.counters);
    found->second.is_dirty = true;
    keep_after(kKeepAfter);
    return true;
  }
  /// Stores what has changed, now.
  void keep();
  /// After this the job is not live; what was not stored is stored, now or later.
  void end(const std::string& job);
  /// What could not be stored of a job; nothing: all is.
  [[nodiscard]] std::optional<JobCounters> unkept(const std::string& job) const {
    const auto found = jobs_.find(job);
    if (found == jobs_.end() || !found->second.is_dirty) return {};
    return found->second.counters;
  }
  [[nodiscard]] std::vector<std::string> jobs() const;

 private:
  struct Live {
    JobCounters counters;
    bool is_dirty = false;
    bool is_over = false;  ///< there only because its last counters are not stored yet
  };
  static constexpr Nanoseconds kKeepAfter = std::chrono::milliseconds{100};
  static constexpr Nanoseconds kRetryAfter = std::chrono::seconds{1};
  void keep_after(Nanoseconds pause);

  net::Loop& loop_;
  Keep store_;
  std::map<std::string, Live> jobs_;
  bool is_keeping_soon_ = false;
  std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);
};

}  // namespace telefab
