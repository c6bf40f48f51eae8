// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <telefab/net/loop.hpp>
#include <telefab/store/fleet_queue.hpp>
#include <thread>
#include <utility>

namespace telefab {

/// A site as a member of a fleet.
struct FleetMembership {
  std::string where;  ///< the queue of the fleet, as open_fleet has it; empty: the site is in none
  std::string name;   ///< of the site in the fleet, a job id (is_job_id)
  /// Not from the command line: what a test puts in place of open_fleet. Called on a thread of its own.
  std::function<Result<std::unique_ptr<FleetQueue>>(const Clock&)> open = {};
  [[nodiscard]] bool is_any() const { return !where.empty() || open; }
  /// The clock must outlive what is opened.
  [[nodiscard]] Result<std::unique_ptr<FleetQueue>> opened(const Clock& clock) const {
    return open ? open(clock) : open_fleet(where, clock);
  }
};

/// A site's line to the queue of its fleet: a thread of its own, "fleet", that alone talks to it, since a call may wait
/// for the database. Threads: the loop's.
class FleetLink {
 public:
  /// Opens the queue; called again, later and later, until it is there.
  using Opening = std::function<Result<std::unique_ptr<FleetQueue>>()>;
  /// `changed`: something in the queue may have changed, by whomever; on the loop. The loop must outlive the link.
  FleetLink(net::Loop& loop, Opening open, std::function<void()> changed);
  /// What was asked and is not answered yet stays so.
  ~FleetLink();
  FleetLink(const FleetLink&) = delete;
  FleetLink& operator=(const FleetLink&) = delete;

  /// `work` is done with the queue on the link's thread, in the order in which it was asked; `done` is told on the loop
  /// what came of it, or why the queue is not there: Unreachable, or what opening it failed with.
  template <class Value>
  void ask(std::function<Result<Value>(FleetQueue&)> work, std::function<void(Result<Value>)> done) {
    add([this, work = std::move(work), done = std::move(done)](FleetQueue* queue, const Error& why) {
      auto answer =
          std::make_shared<Result<Value>>(queue != nullptr ? work(*queue) : Result<Value>{tl::unexpected{why}});
      const Error away = *answer ? Error{ErrorCode::Internal, ""} : answer->error();
      reply(away, [answer, done] { done(std::move(*answer)); });
    });
  }
  /// Why the queue does not answer, by the last answer; empty: it does.
  [[nodiscard]] const std::string& why_away() const { return why_away_; }

 private:
  /// The queue, or null and why there is none.
  using Task = std::function<void(FleetQueue* queue, const Error& why)>;
  void add(Task task);
  /// From the link's thread to the loop's, unless the link has ended.
  void reply(const Error& why, std::function<void()> done);
  void run(const std::stop_token& stop);
  [[nodiscard]] bool take(Task& task, Nanoseconds longest, const std::stop_token& stop);

  net::Loop& loop_;
  Opening open_;
  std::function<void()> changed_;
  std::string why_away_;
  std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< the loop's thread only
  std::mutex mutex_;
  std::condition_variable_any grown_;
  std::deque<Task> tasks_;  ///< guarded by mutex_
  std::jthread thread_;     ///< last: everything above is there before it runs
};

}  // namespace telefab
