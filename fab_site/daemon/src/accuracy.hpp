// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/machine/profile_catalogue.hpp>

namespace telefab::fab {

/// Computes what the masks of a planned job will cure, by `telefab-fab predict` as a process of its own: it takes a
/// gigabyte for a large part, and the daemon that prints must not stand for it. Of low priority, on one thread, and the
/// first to go where memory runs out. Leaves report/accuracy.json, then report/accuracy.png in the job's folder. Blocks
/// until it has ended, or was killed because of the token (Cancelled). Fails with Internal where it ends badly; its own
/// words are on standard error.
[[nodiscard]] Result<void> keep_accuracy(const std::filesystem::path& job_folder, const ProfileChoice& printed_with,
                                         const std::string& machine_folder, const std::stop_token& stop);

}  // namespace telefab::fab
