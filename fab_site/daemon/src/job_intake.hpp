// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <set>
#include <telefab/fab/print/lease_book.hpp>
#include <telefab/fab/support/part_regions.hpp>
#include <telefab/service/site.hpp>

#include "job_planner.hpp"
#include "scan_session.hpp"
#include "site_keys.hpp"
#include "stack_shelf.hpp"

namespace telefab::fab {

/// Jobs on their way in, from scan sites and as uploads, until their layers are whole here; then the planner has them.
/// Threads: the loop's.
class JobIntake final : public StackReceiver {
 public:
  /// Whether the fab takes jobs of a fleet.
  enum class InFleet : std::uint8_t { No, Yes };
  /// Site, planner and leases must outlive it. `policy`: what may light by itself when the site starts.
  JobIntake(Site& site, SiteKeys keys, StartPolicy policy, JobPlanner& planner, LeaseBook& leases, InFleet in_fleet);

  Result<OfferAnswer> take_offer(const Offer& offer, const net::Peer& peer) override;
  OfferDeferred put_off(const std::string& job, DeferReason reason, const std::string& why) override;
  void received(const std::string& job, std::uint32_t layers, std::uint64_t bytes) override;
  void completed(const std::string& job) override;
  std::optional<OfferDeferred> send_again(const std::string& job) override;
  void broken(const std::string& job, const Error& why) override;

  /// Makes the job whose layers write_upload has put on disk.
  [[nodiscard]] Result<Job> take_upload(const NewJob& upload);
  /// Goes on with a job that was not planned when the site ended last. Fails where its folder cannot be read.
  [[nodiscard]] Result<void> resume(const Job& job);

 private:
  struct Live {
    std::shared_ptr<Intake> intake;         ///< until the stack is whole
    std::shared_ptr<LayerStream> analysis;  ///< of its layers, likewise
  };
  [[nodiscard]] JobTracker& tracker() const { return site_.tracker(); }
  /// The layers of the offered job, where another job of its site has them here.
  [[nodiscard]] Result<void> look_for_layers(const Offer& offer, const std::string& site,
                                             const std::filesystem::path& folder);
  /// What speaks against an offer as one of a fleet's attempts, for now; nothing: it may be taken. Refused for good:
  /// NotPermitted (no fleet), Conflict (an older attempt, another site's).
  [[nodiscard]] Result<std::optional<OfferDeferred>> check_attempt(const Offer& offer, const std::string& site);
  /// The intake of an offer that nothing speaks against; what fails now is the disk, or the job's own folder.
  [[nodiscard]] Result<std::shared_ptr<Intake>> open_intake(const Offer& offer, const MachineProfile& machine,
                                                            const std::string& site, const std::string& signer);
  /// A job that is put off once more within this time waits for the disk; later it waits for its scan site.
  void expect_again(const std::string& job, Nanoseconds within);

  Site& site_;
  SiteKeys keys_;
  StartPolicy policy_;
  JobPlanner& planner_;
  LeaseBook& leases_;
  InFleet in_fleet_;
  StackShelf shelf_;
  std::set<std::string> taken_over_;  ///< jobs whose layers were here as another's, and whose end is not here yet
  std::set<std::string> to_be_sent_;  ///< jobs whose layers turned out to be others than those
  std::map<std::string, Live> live_;
  std::map<std::string, std::uint64_t>
      put_off_;  ///< how often for the disk's sake, by job; until it is offered no more
};

}  // namespace telefab::fab
