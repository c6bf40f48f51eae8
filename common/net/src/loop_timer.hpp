// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "loop_impl.hpp"

namespace telefab::net {

/// One wait at a time on the clock of a loop. Threads: the loop's.
class LoopTimer {
 public:
  explicit LoopTimer(Loop& loop) : loop_{loop.impl()} {}
  ~LoopTimer() { cancel(); }
  LoopTimer(const LoopTimer&) = delete;
  LoopTimer& operator=(const LoopTimer&) = delete;

  /// Calls `work` after that time, instead of what was waited for before.
  void start(Nanoseconds after, std::function<void()> work) {
    cancel();
    wait_ = loop_.wait(after, std::move(work));
  }
  void cancel() {
    if (wait_) loop_.forget(*std::exchange(wait_, std::nullopt));
  }

 private:
  Loop::Impl& loop_;
  std::optional<Loop::Impl::WaitId> wait_;
};

}  // namespace telefab::net
