// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <mutex>
#include <telefab/scan/web/scan_web.hpp>
#include <telefab/service/disk_room.hpp>
#include <telefab/service/web_page.hpp>
#include <telefab/store/job_store.hpp>

#include "cut_layers.hpp"

namespace telefab::scan {

/// The daemon as its web page sees it: reads the store and the job folders itself, passes commands on. Lives on the
/// thread "web", but for set_link.
class SitePageBackend final : public PageBackend {
 public:
  /// Store, room and folder must outlive the backend.
  SitePageBackend(JobStore& store, const DiskRoom& room, const DataFolder& folder, SpoolRegistry& spools, LinkView link,
                  CommandPost post, FilePost files)
      : store_{store},
        room_{room},
        folder_{folder},
        layers_{spools},
        link_{std::move(link)},
        post_{std::move(post)},
        files_{std::move(files)} {}

  Result<std::vector<Job>> jobs() override;
  Result<JobPage> find(const JobQuery& query) override { return store_.list(query); }
  Result<Job> job(std::string_view id) override { return store_.find(id); }
  Result<std::vector<JobEvent>> events(std::string_view id) override;
  Result<std::string> report(std::string_view id) override;
  Result<std::string> layer_json(std::string_view id, std::uint32_t layer) override;
  LinkView link() override;
  Result<std::string> fleet() override;
  Result<void> act(std::string_view id, JobCommand command, std::string_view who) override;
  Result<void> approve(std::string_view id, std::string_view although, std::string_view who) override;
  Result<std::string> preflight(std::string_view id) override;
  Result<void> healthy() override {
    if (auto good = store_.health(); !good) return good;
    return room_.health();
  }
  std::uint64_t revision() override;

  /// From any thread.
  void set_link(bool is_up, const std::string& why_down);
  void set_fleet(std::string json);

 private:
  JobStore& store_;
  const DiskRoom& room_;
  const DataFolder& folder_;
  CutLayers layers_;
  std::mutex mutex_;
  LinkView link_;                    ///< guarded by mutex_
  std::string fleet_;                ///< guarded by mutex_; empty: not known
  std::uint64_t link_revision_ = 0;  ///< guarded by mutex_
  CommandPost post_;
  FilePost files_;
};

}  // namespace telefab::scan
