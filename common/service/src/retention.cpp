// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/service/retention.hpp>

namespace telefab {
namespace {

constexpr std::int64_t kDay_ms = 24LL * 3600 * 1000;

}  // namespace

std::vector<Outlived> outlived(const std::vector<Job>& ended, const std::map<std::string, std::uint64_t>& bytes,
                               const RetentionPolicy& policy, std::int64_t now_unix_ms) {
  const auto bytes_of = [&](const Job& job) {
    const auto found = bytes.find(job.id);
    return found == bytes.end() ? 0 : found->second;
  };
  std::uint64_t left = 0;
  for (const Job& job : ended) left += bytes_of(job);
  std::vector<Outlived> gone;
  for (const Job& job : ended) {
    const bool is_old = policy.keep_days > 0 && now_unix_ms - job.changed_unix_ms > policy.keep_days * kDay_ms;
    const bool is_much = policy.keep_gib > 0 && left > policy.keep_gib << 30U;
    if (!is_old && !is_much) continue;
    left -= bytes_of(job);
    gone.push_back({job.id, is_old ? fmt::format("it ended more than {} days ago", policy.keep_days)
                                   : fmt::format("jobs that have ended take more than {} GiB", policy.keep_gib)});
  }
  return gone;
}

}  // namespace telefab
