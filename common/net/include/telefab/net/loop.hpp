// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <telefab/base/clock.hpp>

namespace telefab::net {

/// The event loop of one thread: sockets and timers. Listeners and connections belong to one loop and are touched by
/// its thread only; `post` is the way in from other threads.
class Loop {
 public:
  Loop();
  /// Its timers, and with them those of its connections, go by that clock, which must outlive it.
  explicit Loop(const Clock& clock);
  ~Loop();
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  /// Runs until stop(). The calling thread is the loop's thread meanwhile.
  void run();
  /// Runs until stop() or until `duration` has passed; true when stopped.
  bool run_for(Nanoseconds duration);
  /// Lets that time pass on the loop's own clock, from one timer to the next, with everything the sockets bring between
  /// them; returns in as long as the work takes. True when stopped.
  bool pass(VirtualClock& clock, Nanoseconds duration);
  /// Ends run() soon. Any thread.
  void stop();
  /// Calls `work` on the loop's thread. Any thread.
  void post(std::function<void()> work);
  /// Calls `work` once, after `duration`, on the loop's thread. There is no way to take it back: let `work` look
  /// whether it is still wanted.
  void after(Nanoseconds duration, std::function<void()> work);

  struct Impl;
  [[nodiscard]] Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab::net
