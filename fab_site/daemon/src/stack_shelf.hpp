// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/wire/stack_key.hpp>

namespace telefab::fab {

/// Which job's folder holds the layers of a key, a file a key in DATA/stacks. What it says is a hint: the job may be
/// forgotten by now. Threads: any, for one key one at a time.
class StackShelf {
 public:
  explicit StackShelf(std::filesystem::path folder) : folder_{std::move(folder)} {}
  /// All layers of the offer are in its job's folder. Fails as write_file_atomically.
  [[nodiscard]] Result<void> put(const Offer& offer) const;
  /// A job other than the offer's own that has its layers; nothing: none is known.
  [[nodiscard]] std::optional<std::string> job_with(const Offer& offer) const;

 private:
  std::filesystem::path folder_;
};

/// Whether the layers of `offer` lie whole in `from`, the folder of another job of the same site, and have a second
/// name in `to` now, the folder of the offered job, which has none yet. False where that cannot be: they are sent then.
/// Fails with StorageFailed.
[[nodiscard]] Result<bool> take_over_stack(const Offer& offer, const std::filesystem::path& from,
                                           const std::filesystem::path& to);

}  // namespace telefab::fab
