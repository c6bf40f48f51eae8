// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/scan/web/staging_backend.hpp>
#include <telefab/service/disk_room.hpp>
#include <telefab/service/work_queue.hpp>
#include <telefab/wire/message.hpp>

#include "scan_stager.hpp"

namespace telefab::scan {

/// Makes a job of a file on the daemon's loop; the answer comes on the loop's thread.
using SubmitPost = std::function<void(const Submit&, const std::filesystem::path& file, const std::string& who,
                                      std::function<void(Result<Job>)>)>;
/// A line of the audit log, from any thread.
using NotePost = std::function<void(const std::string& who, const std::string& what)>;

/// The uploads of a daemon and what is known of them, as its page sees them. Lives on the thread "web", but for
/// set_profiles and look_after.
class SiteStagingBackend final : public StagingBackend {
 public:
  /// Store, room and clock must outlive the backend. `incoming`: on the file system of the jobs. `waiting`: a folder
  /// where what is to be copied for a job is kept until it is; what lies there from before is gone on with.
  SiteStagingBackend(UploadStore& uploads, DiskRoom& room, std::filesystem::path incoming,
                     std::filesystem::path waiting, SubmitPost submit, NotePost note);

  Result<std::string> uploads() override;
  Result<std::string> begin(const AnnouncedFile& file, std::string_view who) override;
  Result<std::string> append(std::string_view id, std::uint64_t from_bytes, std::string_view bytes) override;
  Result<std::string> view(std::string_view id) override;
  Result<void> discard(std::string_view id, std::string_view who) override;
  Result<std::string> look(std::string_view id, const StagingQuestion& question) override;
  Result<std::string> estimate(std::string_view id, const StagingQuestion& question) override;
  Result<std::string> orient(std::string_view id, const StagingQuestion& question) override;
  Result<std::string> join(std::string_view id, const std::vector<std::string>& with, std::string_view who) override;
  Result<std::string> level(std::string_view id, std::uint64_t revision, std::uint32_t level) override;
  Result<Job> submit(std::string_view id, const StagingQuestion& question, std::string_view who) override;
  std::string profiles() override;

  /// From any thread.
  void set_profiles(std::shared_ptr<const ProfileCatalogue> profiles, std::string origin);
  /// Removes uploads that nobody has touched for long. From any thread.
  void remove_outlived();

 private:
  [[nodiscard]] std::shared_ptr<const ProfileCatalogue> known_profiles() const;
  struct Asked {
    SliceRequest slice;
    std::optional<ResinPrice> price;  ///< of the resin that it would be printed of
  };
  [[nodiscard]] Result<Asked> request_of(const StagingQuestion& question) const;
  /// NotFound, and Conflict unless all its bytes are there and are right.
  [[nodiscard]] Result<Upload> whole(std::string_view id);
  /// Others leave the disk's room to what is missing of the uploads.
  void expect_missing() { room_.expect("uploads", uploads_.missing_bytes()); }
  /// A scan that becomes a job of its own.
  struct Sending {
    Submit submit;
    std::filesystem::path from, to;
    std::filesystem::path kept;  ///< while it waits for its copy; empty: it waits for none
    std::string who;
    std::promise<Result<Job>> answer;
  };
  /// Fails as whole(), and InvalidInput for the parameters.
  [[nodiscard]] Result<std::shared_ptr<Sending>> sending_of(std::string_view id, const StagingQuestion& question,
                                                            std::string_view who);
  /// Puts it behind what is copied; with `kept` on the disk, it is copied though the daemon ends meanwhile.
  [[nodiscard]] Result<void> wait_for_copy(const std::shared_ptr<Sending>& sending, std::string_view id,
                                           const StagingQuestion& question);
  void begin_copy(const std::shared_ptr<Sending>& sending);
  /// What a daemon that ended has left to be copied.
  void resume_copies();
  [[nodiscard]] Result<std::shared_ptr<Sending>> read_kept(const std::filesystem::path& file);
  /// Copies the scan, where its file system gives no second name, and then makes a job of it; on the thread "copier".
  void copy(const std::string& task, const std::stop_token& stop);
  void make_job(const std::shared_ptr<Sending>& sending);

  UploadStore& uploads_;
  DiskRoom& room_;
  std::filesystem::path incoming_, waiting_;
  SubmitPost submit_;
  NotePost note_;
  std::uint64_t submits_ = 0;
  mutable std::mutex mutex_;
  std::shared_ptr<const ProfileCatalogue> profiles_;        ///< guarded by mutex_
  std::string origin_;                                      ///< guarded by mutex_
  std::map<std::string, std::shared_ptr<Sending>> copies_;  ///< by task; guarded by mutex_
  ScanStager stager_;
  WorkQueue copier_;
};

}  // namespace telefab::scan
