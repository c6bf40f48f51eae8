// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <optional>
#include <telefab/net/loop.hpp>
#include <utility>

#include "asio.hpp"

namespace telefab::net {

struct Loop::Impl {
  using WaitId = std::pair<Nanoseconds, std::uint64_t>;  ///< when, and which of those

  explicit Impl(const Clock& with) : clock{with} {}
  ~Impl();
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  /// Calls `work` once that time has passed on the clock.
  WaitId wait(Nanoseconds after, std::function<void()> work);
  /// Nothing where it was called already.
  void forget(const WaitId& id);
  /// Calls what is due.
  void call_due();
  /// Has the system's timer wake the loop when the next wait is due.
  void set_alarm();

  const Clock& clock;
  // Outlives the context, which destroys what is still under way, and with it timers that forget their waits.
  std::map<WaitId, std::function<void()>> waits;
  boost::asio::io_context context{1};
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> guard{context.get_executor()};
  boost::asio::steady_timer alarm{context};
  std::uint64_t last_wait = 0;
  bool is_passing = false;  ///< pass() goes from wait to wait by itself
};

}  // namespace telefab::net
