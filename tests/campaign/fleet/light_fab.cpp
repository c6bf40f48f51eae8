// SPDX-License-Identifier: GPL-3.0-or-later
#include "light_fab.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <telefab/store/fleet_queue.hpp>
#include <thread>

namespace telefab::test {
namespace {

using Steady = std::chrono::steady_clock;
using namespace std::chrono_literals;

/// Appended and read again by the next life; a process that is killed loses nothing that it wrote.
class Journal {
 public:
  explicit Journal(const std::filesystem::path& path) {
    std::ifstream before{path};
    std::string what, job;
    for (std::string line; std::getline(before, line);) {
      std::istringstream words{line};
      std::uint32_t attempt = 0;
      int layer = 0;
      words >> what >> job >> attempt;
      if (what == "lit" && words >> layer) lit_[{job, attempt}] = layer + 1;
      if (what == "ended") ended_[{job, attempt}] = true;
    }
    file_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  }
  void write(const std::string& line) const {
    const std::string whole = line + "\n";
    if (::write(file_, whole.data(), whole.size()) != static_cast<ssize_t>(whole.size())) std::abort();
  }
  [[nodiscard]] int lit(const std::string& job, std::uint32_t attempt) const {
    const auto found = lit_.find({job, attempt});
    return found == lit_.end() ? 0 : found->second;
  }
  [[nodiscard]] bool has_ended(const std::string& job, std::uint32_t attempt) const {
    return ended_.contains({job, attempt});
  }

 private:
  std::map<std::pair<std::string, std::uint32_t>, int> lit_;
  std::map<std::pair<std::string, std::uint32_t>, bool> ended_;
  int file_ = -1;
};

struct Print {
  fleet::Lease lease;
  Steady::time_point claimed, valid, next, renewed;
  int layer = 0;
  bool is_bound = false;
};

class Fab {
 public:
  explicit Fab(const LightFab& fab) : fab_{fab}, journal_{fab.journal} {
    for (int i = 0; i < fab.machines; ++i) machines_.push_back(fmt::format("{}-m{:03}", fab.name, i));
  }

  [[noreturn]] void run() {
    while (true) {
      if (!queue_) open();
      if (queue_ && !step()) queue_.reset();  // away: opened again
      if (!queue_) std::this_thread::sleep_for(100ms);
      light();  // what is bound goes on, whatever the queue is at
    }
  }

 private:
  void open() {
    auto opened = open_fleet(fab_.queue, clock_);
    if (!opened) return;
    queue_ = std::move(*opened);
    announced_ = {};
    is_new_ = true;
  }

  /// False: the queue is away.
  bool step() {
    if (Steady::now() - announced_ > 10s && !announce()) return false;
    if (is_new_) {
      if (!adopt()) return false;
      is_new_ = false;
    }
    for (auto& [machine, print] : prints_)
      if (!keep(machine, print)) return false;
    std::erase_if(prints_, [](const auto& each) { return !each.second; });
    // As the daemon does: where something happened, and once a second.
    if (is_changed_ || Steady::now() - looked_ > 1s) {
      looked_ = Steady::now();
      if (!claim()) return false;
    }
    const auto waited = queue_->wait(prints_.empty() ? 200ms : 20ms);
    if (!waited) return false;
    is_changed_ = *waited;
    return true;
  }

  bool announce() {
    std::vector<fleet::Machine> all;
    for (const std::string& name : machines_) {
      fleet::Machine m;
      m.name = name, m.profile = "light", m.light = "light", m.resin = "grey";
      m.width_mm = m.depth_mm = m.height_mm = 100, m.pixel_mm = 0.05;
      all.push_back(std::move(m));
    }
    const auto kept = queue_->announce({fab_.name, "127.0.0.1:1", "", "{}"}, all);
    if (!kept || !queue_->expire()) return false;
    announced_ = Steady::now();
    return true;
  }

  /// Leases of an earlier life.
  bool adopt() {
    for (const std::string& machine : machines_) {
      const auto now = Steady::now();
      const auto leases = queue_->leases_of(machine);
      if (!leases) return false;
      for (const fleet::Lease& lease : *leases)
        if (!prints_.contains(machine)) begin(machine, lease, now);
    }
    return true;
  }

  void begin(const std::string& machine, const fleet::Lease& lease, Steady::time_point asked) {
    Print print;
    print.lease = lease;
    print.claimed = print.renewed = asked;
    print.valid = asked + std::chrono::milliseconds{lease.left_ms} - margin();
    print.is_bound = lease.is_bound;
    print.layer = journal_.lit(lease.job, lease.attempt);
    print.next = Steady::now();
    prints_[machine] = print;
  }
  [[nodiscard]] std::chrono::milliseconds margin() const { return std::chrono::milliseconds{fab_.lease_ms / 6}; }

  bool claim() {
    std::vector<std::string> free;
    for (const std::string& machine : machines_)
      if (!prints_.contains(machine)) free.push_back(machine);
    while (!free.empty()) {
      const auto asked = Steady::now();
      const auto lease = queue_->claim(free, std::chrono::milliseconds{fab_.lease_ms});
      if (!lease && lease.error().code == ErrorCode::Conflict) {
        is_new_ = true;  // a claim whose answer was lost
        return true;
      }
      if (!lease) return false;
      if (!*lease) return true;
      begin((*lease)->machine, **lease, asked);
      std::erase(free, (*lease)->machine);
      if (!keep((*lease)->machine, prints_.at((*lease)->machine))) return false;
    }
    return true;
  }

  /// Renews, binds and ends.
  bool keep(const std::string&, std::optional<Print>& slot) {
    if (!slot) return true;
    Print& print = *slot;
    const fleet::Lease& lease = print.lease;
    if (Steady::now() - print.renewed > std::chrono::milliseconds{fab_.lease_ms / 4}) {
      const auto asked = Steady::now();
      const auto renewed = queue_->renew(lease.job, lease.attempt, std::chrono::milliseconds{fab_.lease_ms});
      if (!renewed) return false;
      print.renewed = asked;
      if (!*renewed) {  // somebody else's by now
        slot.reset();
        return true;
      }
      print.valid = asked + std::chrono::milliseconds{(*renewed)->left_ms} - margin();
    }
    if (!print.is_bound) {
      const auto bound = queue_->bind(lease.job, lease.attempt);
      if (!bound) return false;
      if (!*bound) {
        slot.reset();
        return true;
      }
      print.is_bound = true;
      journal_.write(
          fmt::format("started {} {}", lease.job,
                      std::chrono::duration_cast<std::chrono::microseconds>(Steady::now() - print.claimed).count()));
    }
    if (print.layer < fab_.layers || Steady::now() < print.next) return true;
    if (!journal_.has_ended(lease.job, lease.attempt))
      journal_.write(fmt::format("ended {} {}", lease.job, lease.attempt));
    const auto finished = queue_->finish(lease.job, lease.attempt, fleet::State::Done, "");
    if (!finished) return false;
    slot.reset();
    return true;
  }

  /// Every layer whose time has come, under the fence: bound, and of this attempt.
  void light() {
    for (auto& [machine, slot] : prints_) {
      if (!slot || !slot->is_bound || slot->layer >= fab_.layers || Steady::now() < slot->next) continue;
      journal_.write(fmt::format("lit {} {} {}", slot->lease.job, slot->lease.attempt, slot->layer++));
      slot->next = Steady::now() + std::chrono::milliseconds{fab_.print_ms / fab_.layers};
    }
  }

  LightFab fab_;
  Journal journal_;
  SystemClock clock_;
  std::unique_ptr<FleetQueue> queue_;
  std::vector<std::string> machines_;
  std::map<std::string, std::optional<Print>> prints_;  ///< by machine
  Steady::time_point announced_, looked_;
  bool is_changed_ = true;
  bool is_new_ = true;
};

}  // namespace

void print_for_ever(const LightFab& fab) { Fab{fab}.run(); }

std::vector<std::string> words_of(const LightFab& fab) {
  return {"fab",
          fab.queue,
          fab.name,
          fab.journal.string(),
          std::to_string(fab.machines),
          std::to_string(fab.print_ms),
          std::to_string(fab.layers),
          std::to_string(fab.lease_ms)};
}

LightFab light_fab_from(const std::vector<std::string>& words) {
  return {words.at(1),
          words.at(2),
          words.at(3),
          std::stoi(words.at(4)),
          std::stoi(words.at(5)),
          std::stoi(words.at(6)),
          std::stoi(words.at(7))};
}

}  // namespace telefab::test
