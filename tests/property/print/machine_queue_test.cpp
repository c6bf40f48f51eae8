// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <telefab/fab/print/machine_queue.hpp>

// What holds of the queue of a fab whatever happens in whatever order, against a plain model of the same events.

namespace telefab::fab {
namespace {

constexpr std::size_t kMachines = 4;
constexpr int kJobs = 30;
constexpr int kEvents = 2000;

/// What the events so far mean, kept as simply as can be.
struct Model {
  std::map<std::string, std::size_t> at;                  ///< machine by job that is at one
  std::map<std::string, std::size_t> begun;               ///< machine by job of which something is made
  std::map<std::string, std::vector<std::size_t>> waits;  ///< machines that fit, by job
  std::array<std::optional<std::string>, kMachines> part;
};

class Chaos {
 public:
  explicit Chaos(std::uint64_t seed) : rng_{seed} {
    std::vector<QueuedMachine> machines;
    for (std::size_t m = 0; m < kMachines; ++m) {
      needs_clearing_[m] = rng_() % 2 == 0;
      machines.push_back({fmt::format("m{}", m), needs_clearing_[m]});
    }
    queue_ = std::make_unique<MachineQueue>(std::move(machines));
  }

  void step() {
    const std::string job = fmt::format("j{}", rng_() % kJobs);
    switch (rng_() % 8) {
      case 0:
      case 1:
        return add(job);
      case 2:
      case 3:
        return assign();
      case 4:
        return release(job);
      case 5:
        queue_->end(job);
        model_.at.erase(job), model_.begun.erase(job), model_.waits.erase(job);
        return;
      case 6:
        queue_->drop(job);
        model_.waits.erase(job);
        return;
      default: {
        const std::size_t machine = rng_() % kMachines;
        // An operator clears what no print is made on.
        const bool is_in_use = std::ranges::any_of(model_.begun, [&](auto& b) { return b.second == machine; }) ||
                               std::ranges::any_of(model_.at, [&](auto& a) { return a.second == machine; });
        if (is_in_use) return;
        queue_->set_part(machine, std::nullopt);
        model_.part[machine].reset();
        queue_->forget_trouble(machine);
      }
    }
  }

  void check() const {
    std::map<std::size_t, int> jobs_at;
    for (const auto& [job, machine] : model_.at) {
      ASSERT_EQ(queue_->machine_of(job), machine);
      ASSERT_FALSE(queue_->waits(job)) << job << " is at a machine and waits";
      ASSERT_EQ(++jobs_at[machine], 1) << "two jobs at one machine";
    }
    for (const auto& [job, fits] : model_.waits) ASSERT_TRUE(queue_->waits(job)) << job << " is lost";
    ASSERT_EQ(queue_->waiting().size(), model_.waits.size());
    for (const auto& [job, machine] : model_.begun) ASSERT_EQ(queue_->begun_on(job), machine);
    for (std::size_t m = 0; m < kMachines; ++m) {
      const MachineStanding standing = queue_->standing(m);
      ASSERT_EQ(standing == MachineStanding::Printing, jobs_at.contains(m)) << "nothing is paused here";
      ASSERT_TRUE(standing != MachineStanding::Occupied || (needs_clearing_[m] && model_.part[m]));
    }
  }

  /// Nobody waits for a machine that would do and stands free.
  void expect_nothing_left_over() {
    assign();
    for (const auto& [job, fits] : model_.waits)
      for (const std::size_t machine : fits) {
        if (model_.begun.contains(job) && model_.begun.at(job) != machine) continue;
        const bool is_own = model_.begun.contains(job);
        ASSERT_FALSE(queue_->standing(machine) == MachineStanding::Idle && (!is_own || machine == model_.begun.at(job)))
            << job << " waits, and m" << machine << " is idle";
      }
  }

 private:
  void add(const std::string& job) {
    std::vector<std::size_t> fits;
    for (std::size_t m = 0; m < kMachines; ++m)
      if (rng_() % 2 == 0) fits.push_back(m);
    std::shuffle(fits.begin(), fits.end(), rng_);
    queue_->add(job, fits, rng_() % 4 == 0 ? InTrouble::Tries : InTrouble::Waits);
    if (!model_.at.contains(job)) model_.waits[job] = fits;
  }

  void assign() {
    const auto order = queue_->waiting();
    std::size_t last = 0;
    for (const Assignment& made : queue_->assign()) {
      const auto place = std::ranges::find(order, made.job);
      ASSERT_NE(place, order.end()) << "a job that did not wait";
      ASSERT_GE(static_cast<std::size_t>(place - order.begin()), last) << "out of order";
      last = static_cast<std::size_t>(place - order.begin());
      const auto own = model_.begun.find(made.job);
      if (own != model_.begun.end())
        ASSERT_EQ(own->second, made.machine) << "a part cannot be moved";
      else
        ASSERT_NE(std::ranges::find(model_.waits.at(made.job), made.machine), model_.waits.at(made.job).end());
      for (const auto& [job, machine] : model_.at) ASSERT_NE(machine, made.machine) << "it is at work";
      for (const auto& [job, machine] : model_.begun)
        ASSERT_TRUE(machine != made.machine || job == made.job || own != model_.begun.end())
            << "another's part hangs there";
      const auto& part = model_.part[made.machine];
      ASSERT_TRUE(!needs_clearing_[made.machine] || !part || *part == made.job || own != model_.begun.end())
          << "the platform is not empty";
      model_.waits.erase(made.job);
      model_.at[made.job] = made.machine;
      model_.part[made.machine] = made.job;
      model_.begun.try_emplace(made.job, made.machine);
      queue_->set_part(made.machine, made.job);
      queue_->begin(made.job, made.machine);
    }
  }

  void release(const std::string& job) {
    const auto at = model_.at.find(job);
    if (at == model_.at.end()) return;
    const std::size_t machine = at->second;
    model_.at.erase(at);
    queue_->release(job, static_cast<MachineTrouble>(rng_() % 3));
    if (rng_() % 2 == 0) return;
    queue_->forget_begun(job);
    model_.begun.erase(job);
    queue_->set_part(machine, std::nullopt);
    model_.part[machine].reset();
  }

  std::mt19937_64 rng_;
  std::array<bool, kMachines> needs_clearing_{};
  std::unique_ptr<MachineQueue> queue_;
  Model model_;
};

TEST(MachineQueueUnderChaos, LosesNoJobMovesNoPartAndNeverPutsTwoOnAMachine) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE(seed);
    Chaos chaos{seed};
    for (int event = 0; event < kEvents; ++event) {
      chaos.step();
      chaos.check();
      if (testing::Test::HasFatalFailure()) return;
      if (event % 50 == 0) chaos.expect_nothing_left_over();
      if (testing::Test::HasFatalFailure()) return;
    }
  }
}

TEST(MachineQueueUnderChaos, AssignsTheSameInTheSameOrderOfEvents) {
  const auto play = [](std::uint64_t seed) {
    std::mt19937_64 rng{seed};
    MachineQueue queue{{{"a", false}, {"b", false}, {"c", false}}};
    std::string story;
    for (int event = 0; event < 500; ++event) {
      const std::string job = fmt::format("j{}", rng() % 20);
      if (rng() % 3 == 0)
        queue.end(job);
      else
        queue.add(job, rng() % 2 == 0 ? std::vector<std::size_t>{0, 1, 2} : std::vector<std::size_t>{2, 1, 0});
      for (const Assignment& made : queue.assign()) story += fmt::format("{}>{} ", made.job, made.machine);
    }
    return story;
  };
  EXPECT_FALSE(play(7).empty());
  EXPECT_EQ(play(7), play(7));
}

}  // namespace
}  // namespace telefab::fab
