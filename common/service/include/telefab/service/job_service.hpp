// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <functional>
#include <telefab/net/trust.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/wire/message.hpp>

namespace telefab {

/// A site as its clients see it; the daemon of each site implements it. Called on the loop's thread; answers that
/// need the other site come later, through the callbacks, on the same thread.
class JobService {
 public:
  virtual ~JobService() = default;
  JobService(const JobService&) = delete;
  JobService& operator=(const JobService&) = delete;

  [[nodiscard]] virtual JobStore& store() = 0;
  /// The profiles one can submit for, and what stands in the fab as far as it answers.
  virtual void machines(std::function<void(Machines)> done) = 0;
  /// Looked at before a byte of the scan is taken: machine, parameters, room on disk.
  [[nodiscard]] virtual Result<void> may_submit(const Submit& submit) = 0;
  /// Where uploads under way lie; on the same file system as the jobs.
  [[nodiscard]] virtual std::filesystem::path incoming() = 0;
  /// So many bytes of this upload are still to come: others leave them room. None: no more come.
  virtual void expect_upload(const std::filesystem::path& upload, std::uint64_t missing_bytes) = 0;
  /// The scan has arrived whole. Takes the file.
  [[nodiscard]] virtual Result<Job> submit(const Submit& submit, const std::filesystem::path& upload,
                                           std::string_view owner) = 0;
  virtual void command(const Command& command, std::function<void(Result<Job>)> done) = 0;
  virtual void files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) = 0;
  /// A local copy of one of files().
  virtual void file(const std::string& job, const std::string& name,
                    std::function<void(Result<std::filesystem::path>)> done) = 0;
  /// For the audit log: what somebody did, or was refused.
  virtual void note(std::string_view who, std::string_view what) = 0;

 protected:
  JobService() = default;
};

/// The plain files of a folder, by name; empty where there is no such folder.
[[nodiscard]] std::vector<FileEntry> files_of(const std::filesystem::path& folder);

}  // namespace telefab
