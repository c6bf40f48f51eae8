// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <mutex>
#include <set>
#include <string>

namespace telefab::fab {

/// Jobs of which a layer was perhaps exposed, and nobody has decided yet. Threads: any.
class ExposureQuestions {
 public:
  [[nodiscard]] bool contains(const std::string& job) const {
    const std::lock_guard lock{mutex_};
    return jobs_.contains(job);
  }
  void set(const std::string& job, bool is_unknown) {
    const std::lock_guard lock{mutex_};
    if (is_unknown)
      jobs_.insert(job);
    else
      jobs_.erase(job);
  }

 private:
  mutable std::mutex mutex_;
  std::set<std::string> jobs_;
};

}  // namespace telefab::fab
