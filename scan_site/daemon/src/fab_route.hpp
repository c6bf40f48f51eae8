// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/job/job.hpp>
#include <telefab/job/machine_status.hpp>

#include "fab_link.hpp"
#include "job_wishes.hpp"

namespace telefab::scan {

/// What a route tells the site. Jobs are named by their ids at this site.
struct RouteEvents {
  /// What is reached, or is not any more, has changed. `what`: of this, "the fab HOST:PORT".
  std::function<void(const std::string& what, bool is_up, const std::string& why)> changed;
  std::function<void()> reached;  ///< a fab of the fleet is, and may be asked what could not be asked before
  /// Machines and queue of the fleet, as PageBackend::fleet() has them.
  std::function<void(std::string json)> standing;
  FabLinkEvents jobs;  ///< but for `changed`
  /// The fleet has taken the job from the machine that had it: it waits for another.
  std::function<void(const std::string& job, const std::string& why)> taken_back;
  /// The fleet says that it has ended, and how.
  std::function<void(const std::string& job, JobState end, const std::string& message)> ended;
};

/// Where this site's jobs are printed: at the one fab of --fab (OneFab), or at the fabs of a fleet (FleetRoute). Jobs
/// are named by their ids at this site, whatever they are called elsewhere. Threads: the loop's.
class FabRoute {
 public:
  virtual ~FabRoute() = default;
  FabRoute(const FabRoute&) = delete;
  FabRoute& operator=(const FabRoute&) = delete;

  virtual void start() = 0;
  /// "HOST:PORT" of the fab, or where the queue of the fleet is.
  [[nodiscard]] virtual std::string address() const = 0;
  /// "the fab HOST:PORT", "the fleet".
  [[nodiscard]] virtual std::string name() const = 0;
  [[nodiscard]] virtual bool is_up() const = 0;
  [[nodiscard]] virtual bool is_fleet() const = 0;
  /// What may be submitted for; null until it was reached once.
  [[nodiscard]] virtual const ProfileCatalogue* profiles() const = 0;
  /// The profile of what somebody asks for: itself, or that of a machine of that name.
  [[nodiscard]] virtual std::string profile_of(const std::string& machine) const = 0;
  /// Which machine an offer of a job that is cut for `profile` asks its fab for.
  [[nodiscard]] virtual std::string asked_of_fab(const std::string& machine, const MachineProfile& profile) const = 0;
  /// What the machines are at now, or why that is not known.
  virtual void machines(std::function<void(Result<std::vector<MachineStatus>>)> done) = 0;

  /// A job's layers are to be printed, and are sent as they come into the spool.
  virtual void add(const Offer& offer, std::shared_ptr<SharedSpool> spool, const JobWishes& wishes) = 0;
  [[nodiscard]] virtual bool knows(const std::string& job) const = 0;
  /// More chunks, or the end, are in the job's spool.
  virtual void pump(const std::string& job) = 0;
  virtual void forget(const std::string& job) = 0;
  /// Why a job does not go out now; empty: it does.
  [[nodiscard]] virtual std::string why_waiting(const std::string& job) const = 0;
  /// A job that was ended here is to be ended there too. Where it fails nothing has changed, and it is asked again once
  /// changed() or reached() says that more is.
  virtual void cancel(const std::string& job, const std::string& who, std::function<void(Result<void>)> done) = 0;

  /// The line to a fab, and what that calls the job.
  struct AtFab {
    FabLink* link = nullptr;  ///< may be down
    std::string id;
  };
  /// Where the job is. NotFound: no fab has it.
  [[nodiscard]] virtual Result<AtFab> fab_of(const std::string& job) = 0;

 protected:
  FabRoute() = default;
};

/// The fab of --fab.
class OneFab final : public FabRoute {
 public:
  /// As FabLink.
  OneFab(net::Loop& loop, net::ConnectOptions options, std::string site_key, RouteEvents events);

  void start() override { link_.start(); }
  [[nodiscard]] std::string address() const override { return fab_; }
  [[nodiscard]] std::string name() const override { return "the fab " + fab_; }
  [[nodiscard]] bool is_up() const override { return link_.is_up(); }
  [[nodiscard]] bool is_fleet() const override { return false; }
  [[nodiscard]] const ProfileCatalogue* profiles() const override;
  [[nodiscard]] std::string profile_of(const std::string& machine) const override { return machine; }
  [[nodiscard]] std::string asked_of_fab(const std::string& machine, const MachineProfile&) const override {
    return machine;
  }
  void machines(std::function<void(Result<std::vector<MachineStatus>>)> done) override;
  void add(const Offer& offer, std::shared_ptr<SharedSpool> spool, const JobWishes&) override {
    link_.add(offer, std::move(spool));
  }
  [[nodiscard]] bool knows(const std::string& job) const override { return link_.knows(job); }
  void pump(const std::string& job) override { link_.pump(job); }
  void forget(const std::string& job) override { link_.forget(job); }
  [[nodiscard]] std::string why_waiting(const std::string& job) const override { return link_.why_waiting(job); }
  void cancel(const std::string& job, const std::string& who, std::function<void(Result<void>)> done) override;
  [[nodiscard]] Result<AtFab> fab_of(const std::string& job) override { return AtFab{&link_, job}; }

 private:
  std::string fab_;
  FabLink link_;
};

/// Cancels a job at a fab. Fails as FabRoute::cancel.
void cancel_at(const FabRoute::AtFab& fab, const std::string& who, std::function<void(Result<void>)> done);
}  // namespace telefab::scan
