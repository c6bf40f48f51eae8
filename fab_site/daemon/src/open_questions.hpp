// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace telefab::fab {

/// What only somebody who looks at the part, or at the printer, can answer about a print that waits.
enum class OpenQuestion : std::uint8_t {
  None,
  Exposure,  ///< a layer was perhaps exposed: treat-as-exposed or expose-again
  Start,     ///< a whole printer perhaps started it: treat-as-started or start-again
};

/// Jobs that wait for such an answer. Threads: any.
class OpenQuestions {
 public:
  [[nodiscard]] OpenQuestion about(const std::string& job) const {
    const std::lock_guard lock{mutex_};
    const auto found = jobs_.find(job);
    return found == jobs_.end() ? OpenQuestion::None : found->second;
  }
  void set(const std::string& job, OpenQuestion question) {
    const std::lock_guard lock{mutex_};
    if (question == OpenQuestion::None)
      jobs_.erase(job);
    else
      jobs_[job] = question;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, OpenQuestion> jobs_;
};

}  // namespace telefab::fab
