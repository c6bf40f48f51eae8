// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <telefab/base/result.hpp>

namespace telefab::fab {

/// Whose part is on the platform of each machine, a file a machine in DATA/platforms, kept over restarts. Threads: any,
/// for one machine one at a time.
class Platforms {
 public:
  explicit Platforms(std::filesystem::path folder) : folder_{std::move(folder)} {}
  /// The job whose part is on it; nothing: it is empty. Fails with StorageFailed; it must then be taken for occupied.
  [[nodiscard]] Result<std::optional<std::string>> part_on(const std::string& machine) const;
  /// Durable when it returns.
  [[nodiscard]] Result<void> occupy(const std::string& machine, const std::string& job) const;
  [[nodiscard]] Result<void> clear(const std::string& machine) const;

 private:
  std::filesystem::path folder_;
};

}  // namespace telefab::fab
