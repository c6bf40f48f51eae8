// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <telefab/service/data_folder.hpp>
#include <thread>

namespace telefab {

/// One thread that takes jobs in the order they came. Destruction stops the work under way and joins.
class WorkQueue {
 public:
  /// Called on the queue's thread; must return soon once the token is stopped.
  using Work = std::function<void(const std::string& job, std::stop_token stop)>;

  WorkQueue(const char* thread_name, Work work)
      : work_{std::move(work)}, thread_{[this, thread_name](std::stop_token stop) {
          run(thread_name, stop);
          has_ended_ = true;
        }} {}
  ~WorkQueue() { end(); }
  WorkQueue(const WorkQueue&) = delete;
  WorkQueue& operator=(const WorkQueue&) = delete;

  /// Behind those that wait; once, however often it is asked for.
  void add(const std::string& job) {
    const std::lock_guard lock{mutex_};
    if (std::find(waiting_.begin(), waiting_.end(), job) != waiting_.end()) return;
    waiting_.push_back(job);
    changed_.notify_all();
  }
  /// Takes the job out of the queue, or stops its work. True when it was under way.
  bool drop(const std::string& job) {
    const std::lock_guard lock{mutex_};
    std::erase(waiting_, job);
    if (current_ != job) return false;
    current_stop_.request_stop();
    return true;
  }
  /// Asks the work under way to stop and returns at once; nothing is begun any more.
  void ask_to_end() {
    thread_.request_stop();
    const std::lock_guard lock{mutex_};
    current_stop_.request_stop();
    changed_.notify_all();
  }
  /// Asks to end and waits for it.
  void end() {
    ask_to_end();
    if (thread_.joinable()) thread_.join();
  }
  /// Nothing is under way nor ever will be.
  [[nodiscard]] bool has_ended() const { return has_ended_; }
  [[nodiscard]] bool is_idle() const {
    const std::lock_guard lock{mutex_};
    return current_.empty();
  }
  /// The daemon ends, as opposed to the job.
  [[nodiscard]] bool is_ending() const { return thread_.get_stop_token().stop_requested(); }

 private:
  void run(const char* thread_name, std::stop_token stop) {
    set_thread_name(thread_name);
    while (true) {
      std::unique_lock lock{mutex_};
      if (!changed_.wait(lock, stop, [&] { return !waiting_.empty(); })) return;
      current_ = std::move(waiting_.front());
      waiting_.pop_front();
      current_stop_ = std::stop_source{};
      const std::stop_token token = current_stop_.get_token();
      const std::string job = current_;
      lock.unlock();
      if (stop.stop_requested()) return;
      work_(job, token);
      lock.lock();
      current_.clear();
    }
  }

  Work work_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::string> waiting_;
  std::string current_;
  std::stop_source current_stop_;
  std::atomic<bool> has_ended_ = false;
  std::jthread thread_;  ///< last: everything above is there before it runs
};

}  // namespace telefab
