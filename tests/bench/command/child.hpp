// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::bench {

/// What a program took until it ended.
struct Spent {
  double wall_s = 0;
  double cpu_s = 0;    ///< all its threads, user and system
  double peak_MB = 0;  ///< of resident memory
};

/// Runs a program with its arguments (without its name), what it prints into `output`, and waits for it. Fails:
/// Internal where it cannot be started or ends with another code than 0; then its last line on the error output is
/// in the message.
[[nodiscard]] Result<Spent> run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                                      const std::filesystem::path& output);

}  // namespace telefab::bench
