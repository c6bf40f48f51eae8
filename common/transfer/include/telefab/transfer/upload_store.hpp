// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/digest.hpp>
#include <vector>

namespace telefab {

/// A file that somebody means to send.
struct UploadPlan {
  std::string name;  ///< for people and readers of formats; never a path
  std::uint64_t size_bytes = 0;
  Digest content;     ///< SHA-256 of the whole file: what it is known by
  std::string owner;  ///< who began it
};

enum class UploadState : std::uint8_t {
  Receiving = 1,  ///< bytes are missing
  Checking = 2,   ///< all bytes are there, nobody has compared the digest yet
  Whole = 3,      ///< all bytes are there and are those announced
  Refused = 4,    ///< the bytes were not those announced, and are gone
};
/// "receiving", "checking", "whole", "refused".
[[nodiscard]] std::string_view name_of(UploadState state);

struct Upload {
  std::string id;  ///< of the digest: the same file is the same upload, whoever sends it, whenever
  UploadPlan plan;
  std::uint64_t received_bytes = 0;
  UploadState state = UploadState::Receiving;
};

/// What a store takes.
struct UploadLimits {
  std::uint64_t most_bytes = 0;                   ///< of one file
  std::size_t most_uploads = 32;                  ///< at once, whole ones included
  std::uint64_t part_bytes = 4U << 20U;           ///< of one part, at most
  Nanoseconds kept_for = std::chrono::hours{24};  ///< an upload that nobody touches goes after this
};

/// Files on their way in, in parts, in a folder: FOLDER/ID/{about.json,part} and, once the digest was compared,
/// FOLDER/ID/scan. What append() has answered outlives kill -9; after a loss of power the digest tells what is missing.
/// An interrupted upload goes on where it stopped: whoever announces the same bytes again is told how many are there.
/// Threads: any.
class UploadStore {
 public:
  /// Takes up what a store before left there; what cannot be read is removed. The clock must outlive the store. Fails
  /// with StorageFailed, NotPermitted.
  [[nodiscard]] static Result<std::unique_ptr<UploadStore>> open(std::filesystem::path folder, UploadLimits limits,
                                                                 const Clock& clock);

  /// The upload of these bytes, begun where there was none; of one that was refused, again from its first byte. Fails:
  /// InvalidInput (name, no bytes), TooLarge (above a limit, which the message states), Conflict (another size under
  /// this digest), StorageFailed.
  [[nodiscard]] Result<Upload> begin(const UploadPlan& plan);
  /// Adds what follows the first `from_bytes`. Fails, and changes nothing: NotFound, Conflict (it goes on at another
  /// byte, which the message states, or all are there), InvalidInput (none, or more than were announced), TooLarge
  /// (the part), StorageFailed.
  [[nodiscard]] Result<Upload> append(std::string_view id, std::uint64_t from_bytes, std::span<const std::byte> part);
  /// Compares the digest of one that is Checking, and makes it Whole, durable, or Refused. Reads the whole file: not
  /// for a thread that must answer. Fails: NotFound, Conflict (another state), NotTrusted (it is refused now),
  /// Cancelled, StorageFailed.
  [[nodiscard]] Result<Upload> check(std::string_view id, std::stop_token stop);
  [[nodiscard]] Result<Upload> find(std::string_view id) const;
  /// In the order of their ids.
  [[nodiscard]] std::vector<Upload> list() const;
  /// Its bytes go. Fails: NotFound, StorageFailed.
  [[nodiscard]] Result<void> remove(std::string_view id);
  /// The file of one that is Whole; it lies there until remove(), and is never changed. Fails: NotFound, Conflict.
  [[nodiscard]] Result<std::filesystem::path> file(std::string_view id) const;
  /// Somebody uses it: its time begins again.
  void touch(std::string_view id);
  /// Removes what nobody has touched for as long as the limits say; the ids.
  std::vector<std::string> remove_outlived();
  /// What unfinished uploads still want of the disk.
  [[nodiscard]] std::uint64_t missing_bytes() const;
  [[nodiscard]] const UploadLimits& limits() const { return limits_; }

 private:
  struct Kept {
    Upload upload;
    Nanoseconds touched{};
  };
  UploadStore(std::filesystem::path folder, UploadLimits limits, const Clock& clock)
      : folder_{std::move(folder)}, limits_{limits}, clock_{clock} {}
  void resume_unfinished();
  [[nodiscard]] std::filesystem::path folder_of(std::string_view id) const { return folder_ / std::string{id}; }
  /// mutex_ is held. Fails: NotFound.
  [[nodiscard]] Result<const Kept*> kept(std::string_view id) const;
  [[nodiscard]] Result<Kept*> kept(std::string_view id);

  std::filesystem::path folder_;
  UploadLimits limits_;
  const Clock& clock_;
  mutable std::mutex mutex_;
  std::map<std::string, Kept, std::less<>> uploads_;  ///< by id; guarded by mutex_
};

}  // namespace telefab
