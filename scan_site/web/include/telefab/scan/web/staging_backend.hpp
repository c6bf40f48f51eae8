// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/digest.hpp>
#include <telefab/job/job.hpp>
#include <vector>

namespace telefab::scan {

/// A file that a browser announces.
struct AnnouncedFile {
  std::string name;
  std::uint64_t size_bytes = 0;
  Digest content;  ///< SHA-256 of all of it
};

/// What is asked of an uploaded scan: the same words as of a job.
struct StagingQuestion {
  std::string machine;
  std::string parameters;  ///< JSON object of the one table of parameters
  std::string goal;        ///< of orient: "supports", "height", "quality"
};

/// Scans that lie at the site and are no jobs yet, as the page sees them. Calls come from the web thread one at a time;
/// each returns soon: what takes time is begun, and view() tells how far it is. JSON is one object on one line.
class StagingBackend {
 public:
  virtual ~StagingBackend() = default;
  StagingBackend(const StagingBackend&) = delete;
  StagingBackend& operator=(const StagingBackend&) = delete;

  /// {"limit_bytes","room_bytes","part_bytes","kept_hours","uploads":[...]}.
  [[nodiscard]] virtual Result<std::string> uploads() = 0;
  /// Begins an upload, or finds how far it was: same bytes, same upload. The view of it. Fails: InvalidInput, TooLarge
  /// (a limit), StorageFailed (no room), Conflict.
  [[nodiscard]] virtual Result<std::string> begin(const AnnouncedFile& file, std::string_view who) = 0;
  /// The bytes behind the first `from_bytes`. The view. Fails: NotFound, Conflict (it goes on elsewhere), InvalidInput,
  /// TooLarge, StorageFailed.
  [[nodiscard]] virtual Result<std::string> append(std::string_view id, std::uint64_t from_bytes,
                                                   std::string_view bytes) = 0;
  /// What is there, what is known of it, and how far what was asked is.
  [[nodiscard]] virtual Result<std::string> view(std::string_view id) = 0;
  [[nodiscard]] virtual Result<void> discard(std::string_view id, std::string_view who) = 0;
  /// Begins to prepare, estimate, or turn it; what was asked before and is not done is given up. The view. Fails:
  /// NotFound, Conflict (not whole), InvalidInput (machine, parameters).
  [[nodiscard]] virtual Result<std::string> look(std::string_view id, const StagingQuestion& question) = 0;
  [[nodiscard]] virtual Result<std::string> estimate(std::string_view id, const StagingQuestion& question) = 0;
  [[nodiscard]] virtual Result<std::string> orient(std::string_view id, const StagingQuestion& question) = 0;
  /// Begins to join it with others, views of one object in any pose; view() tells the id of what comes out. The view.
  /// Fails: NotFound, Conflict (one is not whole), InvalidInput (no other, or the same twice).
  [[nodiscard]] virtual Result<std::string> join(std::string_view id, const std::vector<std::string>& with,
                                                 std::string_view who) = 0;
  /// A level of detail of the picture, as CloudPicture::level writes it. Fails: NotFound, Conflict (the picture has
  /// another revision by now).
  [[nodiscard]] virtual Result<std::string> level(std::string_view id, std::uint64_t revision, std::uint32_t level) = 0;
  /// A job of it, as one from `telefab submit`. Fails as that does, and with Conflict where it is not whole.
  [[nodiscard]] virtual Result<Job> submit(std::string_view id, const StagingQuestion& question,
                                           std::string_view who) = 0;
  /// {"origin","machines":[{"name","description","loaded_resin",...}],"resins":[...],"prints":[...]}: what one can
  /// choose.
  [[nodiscard]] virtual std::string profiles() = 0;

 protected:
  StagingBackend() = default;
};

}  // namespace telefab::scan
