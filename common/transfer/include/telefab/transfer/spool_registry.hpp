// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <memory>
#include <mutex>
#include <telefab/transfer/chunk_spool.hpp>

namespace telefab {

/// One job's spool, shared by the slicer, which fills it, and the link, which sends it.
class SharedSpool {
 public:
  explicit SharedSpool(ChunkSpool spool) : spool_{std::move(spool)} {}
  /// Calls `work` with the spool while nobody else touches it.
  template <class Work>
  auto with(const Work& work) {
    const std::lock_guard lock{mutex_};
    return work(spool_);
  }

 private:
  std::mutex mutex_;
  ChunkSpool spool_;
};

/// The spools of the jobs at work. Threads: any.
class SpoolRegistry {
 public:
  /// The spool of a job, opened where it was not yet. Fails as ChunkSpool::open.
  [[nodiscard]] Result<std::shared_ptr<SharedSpool>> of(const std::string& job, const std::filesystem::path& folder) {
    const std::lock_guard lock{mutex_};
    auto& slot = spools_[job];
    if (!slot) {
      auto spool = ChunkSpool::open(folder / "chunks");
      if (!spool) return tl::unexpected{spool.error()};
      slot = std::make_shared<SharedSpool>(std::move(*spool));
    }
    return slot;
  }
  /// Nobody works on the job any more; whoever still holds its spool keeps it until then.
  void close(const std::string& job) {
    const std::lock_guard lock{mutex_};
    spools_.erase(job);
  }

 private:
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<SharedSpool>> spools_;
};

}  // namespace telefab
