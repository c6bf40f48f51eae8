// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/fleet_link.hpp>

namespace telefab {
namespace {

/// What is asked meanwhile waits for no longer.
constexpr Nanoseconds kWait = std::chrono::milliseconds{100};
constexpr Nanoseconds kShortestPause = std::chrono::milliseconds{100};
constexpr Nanoseconds kLongestPause = std::chrono::seconds{5};

}  // namespace

FleetLink::FleetLink(net::Loop& loop, Opening open, std::function<void()> changed)
    : loop_{loop}, open_{std::move(open)}, changed_{std::move(changed)}, thread_{[this](const std::stop_token& stop) {
        run(stop);
      }} {}

FleetLink::~FleetLink() {
  *alive_ = false;
  thread_.request_stop();
  thread_.join();
}

void FleetLink::add(Task task) {
  const std::lock_guard lock{mutex_};
  tasks_.push_back(std::move(task));
  grown_.notify_all();
}

void FleetLink::reply(const Error& why, std::function<void()> done) {
  loop_.post([this, alive = alive_, why, done = std::move(done)] {
    if (!*alive) return;
    why_away_ = why.code == ErrorCode::Unreachable || why.code == ErrorCode::StorageFailed ? why.what : std::string{};
    done();
  });
}

bool FleetLink::take(Task& task, Nanoseconds longest, const std::stop_token& stop) {
  std::unique_lock lock{mutex_};
  if (!grown_.wait_for(lock, stop, longest, [&] { return !tasks_.empty(); })) return false;
  task = std::move(tasks_.front());
  tasks_.pop_front();
  return true;
}

void FleetLink::run(const std::stop_token& stop) {
  set_thread_name("fleet");
  std::unique_ptr<FleetQueue> queue;
  Nanoseconds pause = kShortestPause;
  Error why;
  Task task;
  while (!stop.stop_requested()) {
    if (!queue) {
      auto opened = open_();
      if (opened) {
        queue = std::move(*opened);
        pause = kShortestPause;
      } else {
        why = opened.error();
        // Whoever asks is told why at once; the queue is tried again a while later.
        while (take(task, pause, stop)) task(nullptr, why);
        pause = std::min(pause * 2, kLongestPause);
        continue;
      }
    }
    if (take(task, Nanoseconds{0}, stop)) {
      task(queue.get(), why);
      continue;
    }
    const auto changed = queue->wait(kWait);
    if (!changed) {
      // Away; whoever asks next is told so.
      if (take(task, pause, stop)) task(queue.get(), why);
      pause = std::min(pause * 2, kLongestPause);
      continue;
    }
    pause = kShortestPause;
    if (*changed)
      loop_.post([this, alive = alive_] {
        if (*alive) changed_();
      });
  }
}

}  // namespace telefab
