// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/fab/print/print_word.hpp>
#include <telefab/fab/print/start_rule.hpp>
#include <telefab/job/job.hpp>

// The order to print as it lies in a job's folder. Callers see to it that nobody prints from the folder meanwhile.
namespace telefab::fab {

inline constexpr const char* kAutomatic = "automatic";  ///< whose word a job prints by where no operator is asked

/// Keeps a word in the folder's journal; durable when it returns. Fails as keep_word of print does.
[[nodiscard]] Result<void> keep_word(const std::filesystem::path& folder, const Job& job, const PrintWord& word,
                                     Nanoseconds wall);

/// A job as the start rule sees it.
struct StartCase {
  StartFacts facts;
  bool has_begun = false;
  ResumePoint point;
};
/// Whether a layer of it was exposed, or perhaps: its part hangs in the machine where it began.
[[nodiscard]] inline bool is_part_begun(const StartCase& before, const Job& job) {
  return before.point.next.count() > 0 || before.point.maybe_exposed || job.counters.layers_printed > 0;
}
/// Fails: StorageFailed, NotPermitted. A plan that cannot be read is another plan.
[[nodiscard]] Result<StartCase> start_case(const std::filesystem::path& folder, const Job& job);

}  // namespace telefab::fab
