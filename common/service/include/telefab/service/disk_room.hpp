// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <telefab/base/result.hpp>

namespace telefab {

/// Asks a file system how large it is and how much is free; fails with StorageFailed.
using AskSpace = std::function<Result<std::filesystem::space_info>(const std::filesystem::path&)>;

/// Room on the disk of a data folder. A reserve of it lies in a file of its own, DATA/reserve: whoever else fills the
/// disk, the books (jobs.sqlite, the audit log) can still be written once it is given up. Threads: any.
class DiskRoom {
 public:
  /// Takes the reserve as far as there is room. `ask`: the file system itself where it is empty.
  DiskRoom(std::filesystem::path folder, std::uint64_t reserve_bytes, AskSpace ask = {});

  /// Whether so many bytes may be written now, beside what is expected, and the reserve is whole, or can be taken back
  /// beside them. Of no bytes: whether the reserve is. Fails in one sentence with figures: StorageFailed (not now),
  /// TooLarge (never: the disk is smaller).
  [[nodiscard]] Result<void> check(std::uint64_t bytes);
  /// So many bytes that a check has let in are still to come under this name; none: all are here, or nobody sends them
  /// any more.
  void expect(const std::string& what, std::uint64_t bytes);
  /// How many bytes may be written now beside the reserve and what is expected. Fails with StorageFailed.
  [[nodiscard]] Result<std::uint64_t> room() const;
  /// Frees the reserve for what must be written now. False where none was held.
  bool give_up_reserve();
  /// Something could not be written or read: health() says so until a check passes.
  void note_trouble(const Error& error);
  /// The job waits for the disk: health() says so, whatever checks of others find, until it goes on.
  void wait(const std::string& job, const Error& why);
  /// Nothing where it did not wait.
  void go_on(const std::string& job);
  /// Why the last check failed or the reserve is not whole, until a check passes; then which job waits for the disk.
  [[nodiscard]] Result<void> health() const;

 private:
  /// mutex_ is held.
  [[nodiscard]] Result<void> take_reserve();
  /// mutex_ is held.
  [[nodiscard]] std::uint64_t expected_bytes() const;

  std::filesystem::path folder_;
  std::uint64_t reserve_bytes_;
  AskSpace ask_;
  mutable std::mutex mutex_;
  bool is_held_ = false;
  std::optional<Error> trouble_;
  std::map<std::string, Error> waiting_;           ///< by job
  std::map<std::string, std::uint64_t> expected_;  ///< bytes, by what brings them
};

}  // namespace telefab
