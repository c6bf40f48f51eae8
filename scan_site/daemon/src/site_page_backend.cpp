// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_page_backend.hpp"

#include <telefab/base/file.hpp>

namespace telefab::scan {
namespace {

constexpr std::size_t kMostJobs = 200;
constexpr std::size_t kMostEvents = 500;
constexpr std::uint64_t kMaxReportBytes = 64U << 20U;

}  // namespace

Result<std::vector<Job>> SitePageBackend::jobs() { return store_.current(kMostJobs); }

Result<std::vector<JobEvent>> SitePageBackend::events(std::string_view id) {
  if (const auto job = store_.find(id); !job) return tl::unexpected{job.error()};
  return store_.events(id, 0, kMostEvents);
}

Result<std::string> SitePageBackend::report(std::string_view id) {
  if (const auto job = store_.find(id); !job) return tl::unexpected{job.error()};
  const auto folder = folder_.job(id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto bytes = read_file(*folder / "report" / "slice.json", kMaxReportBytes);
  if (!bytes) return fail(ErrorCode::NotFound, "there is no report before all layers are cut");
  return std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

Result<std::string> SitePageBackend::layer_json(std::string_view id, std::uint32_t layer) {
  const auto job = store_.find(id);
  if (!job) return tl::unexpected{job.error()};
  const auto folder = folder_.job(id);
  if (!folder) return tl::unexpected{folder.error()};
  return layers_.json(*job, *folder, layer);
}

LinkView SitePageBackend::link() {
  const std::lock_guard lock{mutex_};
  return link_;
}

void SitePageBackend::set_link(bool is_up, const std::string& why_down) {
  const std::lock_guard lock{mutex_};
  link_.is_up = is_up;
  link_.why_down = is_up ? "" : why_down;
  ++link_revision_;
}

Result<std::string> SitePageBackend::fleet() {
  const std::lock_guard lock{mutex_};
  if (!link_.is_fleet) return fail(ErrorCode::NotFound, "the jobs of this site are printed by one fab");
  if (fleet_.empty()) return fail(ErrorCode::NotFound, "the queue of the fleet was not reached yet");
  return fleet_;
}

void SitePageBackend::set_fleet(std::string json) {
  const std::lock_guard lock{mutex_};
  if (json == fleet_) return;
  fleet_ = std::move(json);
  ++link_revision_;
}

std::uint64_t SitePageBackend::revision() {
  const std::uint64_t jobs = store_.revision();
  const std::lock_guard lock{mutex_};
  return jobs + link_revision_;
}

Result<void> SitePageBackend::act(std::string_view id, JobCommand command, std::string_view who) {
  return carry_out(post_, command, id, who);
}

Result<void> SitePageBackend::approve(std::string_view id, std::string_view although, std::string_view who) {
  return carry_out(post_, JobCommand::Approve, id, who, although);
}

Result<std::string> SitePageBackend::preflight(std::string_view id) {
  const auto path = file_and_wait(files_, std::string{id}, "preflight.json");
  if (!path) return tl::unexpected{path.error()};
  const auto bytes = read_file(*path, kMaxReportBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  return std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

}  // namespace telefab::scan
