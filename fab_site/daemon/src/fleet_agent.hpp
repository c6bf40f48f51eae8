// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <string>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/fab/print/lease_book.hpp>
#include <telefab/fleet/fleet.hpp>
#include <telefab/service/fleet_link.hpp>
#include <telefab/service/site.hpp>

#include "job_dispatcher.hpp"

namespace telefab::fab {

/// The fab as a member of a fleet: announces its machines, claims jobs for those that are free, keeps their leases, has
/// them bound before their first light, gives back what it cannot begin, and tells how they ended. Without the queue
/// the prints go on, and no new job is claimed. Threads: the loop's.
class FleetAgent {
 public:
  /// Site, leases and dispatcher must outlive it.
  FleetAgent(Site& site, FabMembership membership, LeaseBook& leases, JobDispatcher& dispatcher);
  ~FleetAgent();
  FleetAgent(const FleetAgent&) = delete;
  FleetAgent& operator=(const FleetAgent&) = delete;

  /// Begins; leases of an earlier life are taken up again. `port`: that the fab listens on.
  void begin(std::uint16_t port);
  /// Nothing is claimed any more.
  void ask_to_end() { is_ending_ = true; }

 private:
  /// What is asked about an attempt, so that nothing is asked twice at once.
  struct Asking {
    bool is_renewed = false, is_bound = false, is_ended = false;
    Nanoseconds renewed{};
    Nanoseconds since{};  ///< that no layer of it is here
  };
  void tick();
  void look();
  void announce();
  void resume_leases(const std::string& machine);
  /// A job for one of the machines that are free.
  void claim();
  void on_claimed(const std::string& machine, const fleet::Lease& lease, Nanoseconds asked);
  void renew(const FleetHold& hold);
  /// The queue knows of no such lease any more.
  void on_lost(const FleetHold& hold);
  void withdraw(const FleetHold& hold, FenceRefusal why);
  void bind(const LeaseBook::Asked& asked);
  /// What has ended at the site ends in the book, which is told to the queue until it knows.
  void look_for_end(const FleetHold& hold);
  void give_back(const FleetHold& hold, const std::string& why);
  void report(const FleetHold& hold);
  void extend(const std::string& job, std::uint32_t attempt, Nanoseconds asked, std::int64_t left_ms);
  [[nodiscard]] std::string fleet_name(const std::string& machine) const;
  [[nodiscard]] bool is_free(const MachineStatus& machine) const;
  [[nodiscard]] std::vector<fleet::Machine> machines() const;
  [[nodiscard]] JobStore& store() const { return site_.store(); }
  [[nodiscard]] Nanoseconds now() const { return site_.clock().now(); }

  Site& site_;
  FabMembership membership_;
  LeaseBook& leases_;
  JobDispatcher& dispatcher_;
  std::map<std::string, Asking> asking_;           ///< by the fleet's job
  std::map<std::string, Nanoseconds> not_before_;  ///< by machine: it gave a job back, and another is to have it first
  std::vector<fleet::Machine> announced_;
  Nanoseconds announced_at_{};
  std::string catalogue_;
  std::string why_away_;  ///< the queue, as it was last logged
  bool is_announcing_ = false;
  bool is_claiming_ = false;
  bool has_old_leases_ = false;  ///< the leases of an earlier life are known
  bool is_look_due_ = false;
  bool is_ending_ = false;
  std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< for callbacks that outlive it
  FleetLink link_;                                              ///< last: its end is the end of every answer
};

}  // namespace telefab::fab
