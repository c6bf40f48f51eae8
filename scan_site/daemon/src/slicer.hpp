// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <map>
#include <mutex>
#include <telefab/base/clock.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/service/work_queue.hpp>
#include <telefab/wire/message.hpp>

#include <telefab/transfer/spool_registry.hpp>

namespace telefab::scan {

/// One scan to be cut.
struct SliceTask {
  std::string job;
  std::string name;
  std::string owner;
  std::string parameters;
  std::string asked_machine;  ///< a profile, or one machine of it
  MachineProfile machine;
  std::filesystem::path folder;  ///< holds `scan`; receives `chunks`, `offer` and report/slice.json
};

/// Called from the slicer's thread.
struct SlicerEvents {
  std::function<void(const std::string& job)> began;
  std::function<void(const std::string& job, const Offer& offer)> offered;   ///< the header is known
  std::function<void(const std::string& job, std::uint32_t layers)> sliced;  ///< so many are in the spool
  std::function<void(const std::string& job, Result<double> seconds)> ended;
};

/// Cuts one scan after the other on a thread of its own, named "slicer", and fills their spools. Layers that a spool
/// holds already are not cut again.
class Slicer {
 public:
  /// `site_key`: private Ed25519 key in PEM; signs the offers.
  Slicer(SpoolRegistry& registry, const Clock& clock, std::string site_key, SlicerEvents events);
  void add(SliceTask task);
  /// Ends the job's slicing, or takes it out of the queue; no event comes for it any more but `ended` with Cancelled.
  /// True where it was under way: its files are in use until then.
  bool cancel(const std::string& job);

 private:
  void run(const std::string& job, const std::stop_token& stop);
  [[nodiscard]] Result<void> slice(const SliceTask& task, std::stop_token stop);

  SpoolRegistry& spools_;
  const Clock& clock_;
  std::string site_key_;
  SlicerEvents events_;
  std::mutex mutex_;
  std::map<std::string, SliceTask> waiting_;  ///< by job; guarded by mutex_
  WorkQueue queue_;  ///< last: its end stops what is under way, and the spool keeps what it has
};

}  // namespace telefab::scan
