// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <telefab/job/job.hpp>
#include <vector>

namespace telefab {

/// How long a site keeps jobs that have ended. Neither limit ever touches one that has not, nor as-built records, nor
/// the audit log.
struct RetentionPolicy {
  std::uint32_t keep_days = 0;  ///< since the job ended; 0: for ever
  std::uint64_t keep_gib = 0;   ///< of the folders of jobs that have ended; 0: without limit
  [[nodiscard]] bool is_on() const { return keep_days > 0 || keep_gib > 0; }
};

/// A job that goes, and why, for the audit log.
struct Outlived {
  std::string job;
  std::string why;
};
/// The jobs that go now: those too old, then the oldest until the rest fits. `ended`: jobs that are final, the one that
/// ended first first; `bytes`: of their folders, by job, looked at only where keep_gib is set. Pure.
[[nodiscard]] std::vector<Outlived> outlived(const std::vector<Job>& ended,
                                             const std::map<std::string, std::uint64_t>& bytes,
                                             const RetentionPolicy& policy, std::int64_t now_unix_ms);

}  // namespace telefab
