// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <set>
#include <telefab/fleet/fleet.hpp>
#include <telefab/service/fleet_link.hpp>

#include "fab_route.hpp"

namespace telefab::scan {

/// The fabs of a fleet: submits jobs to its queue as soon as their size is known, follows what becomes of them there,
/// and brings their layers to the fab that has a lease of them, as the job of that attempt. How a job ended the queue
/// says, but for a print that is done: what one fab gives up another may print. While the queue is away, what is under
/// way goes on, and what is submitted waits.
class FleetRoute final : public FabRoute {
 public:
  struct Options {
    FleetLink::Opening open;
    std::string where;                  ///< the queue, for people
    std::string site;                   ///< name of this scan site in the fleet
    std::string site_key;               ///< as FabLink has it
    std::shared_ptr<net::Trust> trust;  ///< null without TLS
  };
  FleetRoute(net::Loop& loop, Options options, RouteEvents events);
  ~FleetRoute() override;

  void start() override { tick(); }
  [[nodiscard]] std::string address() const override { return options_.where; }
  [[nodiscard]] std::string name() const override { return "the fleet"; }
  [[nodiscard]] bool is_up() const override { return is_up_; }
  [[nodiscard]] bool is_fleet() const override { return true; }
  [[nodiscard]] const ProfileCatalogue* profiles() const override { return profiles_ ? &*profiles_ : nullptr; }
  [[nodiscard]] std::string profile_of(const std::string& machine) const override;
  /// Any of the kind: which one the lease says.
  [[nodiscard]] std::string asked_of_fab(const std::string&, const MachineProfile& profile) const override {
    return profile.name;
  }
  void machines(std::function<void(Result<std::vector<MachineStatus>>)> done) override;
  void add(const Offer& offer, std::shared_ptr<SharedSpool> spool, const JobWishes& wishes) override;
  [[nodiscard]] bool knows(const std::string& job) const override { return jobs_.contains(job); }
  void pump(const std::string& job) override;
  void forget(const std::string& job) override;
  [[nodiscard]] std::string why_waiting(const std::string& job) const override;
  void cancel(const std::string& job, const std::string& who, std::function<void(Result<void>)> done) override;
  [[nodiscard]] Result<AtFab> fab_of(const std::string& job) override;

 private:
  /// Where an attempt is brought.
  struct Place {
    std::string fab;
    std::string id;  ///< of the attempt, there
  };
  struct Sending {
    Offer offer;  ///< as it was cut, of no attempt
    std::shared_ptr<SharedSpool> spool;
    JobWishes wishes;
    std::optional<fleet::Job> known;  ///< as the queue had it last; nothing: it is to be submitted
    bool is_asked = false;            ///< about it, just now
    bool is_stale = false;            ///< it changed while that was asked
    std::optional<Place> place;       ///< of the attempt that is brought
    std::string why_refused;          ///< by that fab; another may take it
  };
  struct Standing {
    std::vector<fleet::Fab> fabs;
    std::vector<fleet::Machine> machines;
    std::vector<fleet::Job> jobs;  ///< not at their end, at most kMostJobs
    std::int64_t now_unix_ms = 0;  ///< by the clock of the queue
  };
  struct Line {
    fleet::Fab fab;
    std::unique_ptr<FabLink> link;
  };

  void tick();
  void ask_standing();
  void take(Standing standing);
  /// As PageBackend::fleet() has it; the jobs are put in order.
  [[nodiscard]] static std::string json_of(Standing& standing);
  /// Looks at the jobs of what has happened in the queue since the last time.
  void follow();
  /// Every job of which nothing is known yet is submitted.
  void submit_new();
  void look_up(const std::string& job);
  void on_known(const std::string& job, const Result<fleet::Job>& known);
  /// To where the queue says that it is: to a fab, to another, or to none.
  void bring(const std::string& job, Sending& sending);
  void take_back(Sending& sending);
  [[nodiscard]] fleet::NewJob new_job(const Sending& sending) const;
  /// The line to the fab at which a machine stands, made where there was none; null: not known.
  [[nodiscard]] Line* line_of(const std::string& machine);
  [[nodiscard]] FabLinkEvents line_events(const std::string& fab);
  /// The job of an attempt, where that is the one which is brought; empty: it is not.
  [[nodiscard]] std::string job_of(const std::string& fab, const std::string& id) const;
  void on_job_changed(const std::string& fab, Job theirs);
  void on_refused(const std::string& fab, const std::string& id, const Error& why);
  void set_up(bool is_up, const std::string& why);

  net::Loop& loop_;
  Options options_;
  RouteEvents events_;
  std::map<std::string, Sending> jobs_;
  std::map<std::string, Place> places_;  ///< of every job that was brought, also behind its end: its reports are there
  std::map<std::string, std::string> attempts_;  ///< jobs by the ids of the attempts that are brought
  std::map<std::string, Line> lines_;            ///< by fab
  std::map<std::string, fleet::Fab> fabs_;
  std::map<std::string, fleet::Machine> machines_;
  std::optional<ProfileCatalogue> profiles_;
  std::set<std::string> odd_catalogues_;   ///< fabs whose profiles could not be read, as it was logged
  std::optional<std::uint64_t> followed_;  ///< number of the last event that was looked at
  bool is_following_ = false;
  bool is_asking_standing_ = false;
  bool is_standing_wanted_ = true;
  int ticks_to_standing_ = 0;    ///< at most; what happens in the fleet makes it earlier
  bool is_cancel_open_ = false;  ///< one could not be passed on, and is asked for again
  bool is_up_ = false;
  std::string why_down_ = "not tried yet";
  std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< for callbacks that outlive it
  FleetLink link_;                                              ///< last: its end is the end of every answer
};

}  // namespace telefab::scan
