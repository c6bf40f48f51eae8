// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <telefab/fleet/fleet_words.hpp>

// Every job and every machine that do not come together have a reason, and it is the true one: against a model that
// knows nothing of how places are given.

namespace telefab::fleet {
namespace {

constexpr std::int64_t kNow_ms = 1'800'000'000'000;

class Fleets {
 public:
  explicit Fleets(std::uint32_t seed) : random_{seed} {
    const int machines = below(8), jobs = below(14);
    for (int i = 0; i < machines; ++i) machines_.push_back(machine(i));
    for (int i = 0; i < jobs; ++i) jobs_.push_back(job(i));
    std::ranges::shuffle(jobs_, random_);
    std::ranges::shuffle(machines_, random_);
  }
  [[nodiscard]] const std::vector<Machine>& machines() const { return machines_; }
  [[nodiscard]] const std::vector<Job>& jobs() const { return jobs_; }

 private:
  int below(int limit) { return std::uniform_int_distribution{0, limit - 1}(random_); }
  bool rarely() { return below(6) == 0; }

  Machine machine(int number) {
    Machine m;
    m.name = "m" + std::to_string(number);
    m.fab = "la";
    m.profile = rarely() ? "other" : "class";
    m.light = rarely() ? "l2" : "l1";
    m.resin = rarely() ? "tough" : "grey";
    m.width_mm = m.depth_mm = m.height_mm = rarely() ? 20 : 100;
    m.pixel_mm = rarely() ? 0.1 : 0.05;
    m.calibrated_unix_ms = rarely() ? 0 : kNow_ms - 3'600'000;
    m.readiness = rarely() ? static_cast<Readiness>(1 + below(4)) : Readiness::Free;
    m.is_draining = rarely();
    m.seen_unix_ms = rarely() ? kNow_ms - kNotSeen_ms - 1 : kNow_ms - 1000;
    return m;
  }
  Job job(int number) {
    Job j;
    j.id = "j" + std::to_string(number);
    j.place = static_cast<std::uint64_t>(number) + 1;
    j.priority = below(3);
    j.deadline_unix_ms = rarely() ? kNow_ms + below(1000) : 0;
    j.needs.machine = rarely() ? "m0" : rarely() ? "class" : "";
    j.needs.light = rarely() ? "l2" : rarely() ? "" : "l1";
    j.needs.resin = rarely() ? "tough" : rarely() ? "" : "grey";
    j.needs.width_mm = j.needs.depth_mm = j.needs.height_mm = rarely() ? 50 : 10;
    j.needs.pixel_mm = rarely() ? 0.05 : 0;
    j.needs.calibrated_within_ms = rarely() ? 7'200'000 : 0;
    j.state = rarely() ? static_cast<State>(1 + below(7)) : State::Waiting;
    return j;
  }
  std::mt19937 random_;
  std::vector<Machine> machines_;
  std::vector<Job> jobs_;
};

/// Whether a reason is true of a pair, each by itself.
bool is_true(WhyNot why, const Job& j, const Machine& m) {
  switch (why) {
    case WhyNot::Ended:
      return j.state == State::Done || j.state == State::Failed || j.state == State::Cancelled;
    case WhyNot::HasMachine:
      return j.state == State::Claimed || j.state == State::Bound || j.state == State::Asking;
    case WhyNot::OtherMachine:
      return !j.needs.machine.empty() && j.needs.machine != m.name && j.needs.machine != m.profile;
    case WhyNot::OtherLight:
      return !j.needs.light.empty() && j.needs.light != m.light;
    case WhyNot::OtherResin:
      return !j.needs.resin.empty() && j.needs.resin != m.resin;
    case WhyNot::TooLarge:
      return j.needs.width_mm > m.width_mm || j.needs.depth_mm > m.depth_mm || j.needs.height_mm > m.height_mm;
    case WhyNot::CoarserPixel:
      return j.needs.pixel_mm > 0 && m.pixel_mm > j.needs.pixel_mm;
    case WhyNot::CalibratedTooLongAgo:
      return j.needs.calibrated_within_ms > 0 && m.calibrated_unix_ms < kNow_ms - j.needs.calibrated_within_ms;
    case WhyNot::Draining:
      return m.is_draining;
    case WhyNot::NotSeen:
      return m.seen_unix_ms < kNow_ms - kNotSeen_ms;
    case WhyNot::NotFree:
      return m.readiness != Readiness::Free;
    case WhyNot::Fits:
    case WhyNot::LaterInOrder:
    case WhyNot::GoesElsewhere:
      return false;
  }
  return false;
}

bool could_print(const Job& job, const Machine& machine) {
  for (int why = 0; why <= static_cast<int>(WhyNot::GoesElsewhere); ++why)
    if (is_true(static_cast<WhyNot>(why), job, machine)) return false;
  return true;
}

/// Machine by job: each machine by name looks through all jobs for the one that nobody of those before it has.
std::map<std::string, std::string> given(const Fleets& fleet) {
  std::map<std::string, const Machine*> by_name;
  for (const Machine& machine : fleet.machines()) by_name[machine.name] = &machine;
  std::map<std::string, std::string> machine_of;
  for (const auto& [name, machine] : by_name) {
    const Job* best = nullptr;
    for (const Job& job : fleet.jobs())
      if (!machine_of.contains(job.id) && could_print(job, *machine) && (best == nullptr || is_before(job, *best)))
        best = &job;
    if (best != nullptr) machine_of[best->id] = name;
  }
  return machine_of;
}

TEST(EveryPair, OfAJobAndAMachineHasItsReasonAndItIsTrue) {
  std::map<WhyNot, int> seen;
  for (std::uint32_t seed = 0; seed < 4000; ++seed) {
    const Fleets fleet{seed};
    const auto machine_of = given(fleet);
    for (const Job& job : fleet.jobs()) {
      const auto whys = why_nots(job, fleet.jobs(), fleet.machines(), kNow_ms);
      ASSERT_EQ(whys.size(), fleet.machines().size());
      const auto own = machine_of.find(job.id);
      for (std::size_t place = 0; place < whys.size(); ++place) {
        const Machine& machine = fleet.machines()[place];
        const WhyNot why = whys[place];
        ++seen[why];
        SCOPED_TRACE("seed " + std::to_string(seed) + " " + job.id + " on " + machine.name + ": " +
                     std::string{name_of(why)});
        if (!could_print(job, machine)) {
          ASSERT_TRUE(is_true(why, job, machine));
        } else {
          const auto taker = std::ranges::find_if(machine_of, [&](const auto& g) { return g.second == machine.name; });
          const bool is_taken_before =
              taker != machine_of.end() && is_before(*std::ranges::find(fleet.jobs(), taker->first, &Job::id), job);
          if (is_taken_before) {
            ASSERT_EQ(why, WhyNot::LaterInOrder);
          } else {
            ASSERT_NE(own, machine_of.end()) << "nobody has either";
            ASSERT_EQ(why, own->second == machine.name ? WhyNot::Fits : WhyNot::GoesElsewhere);
          }
        }
        ASSERT_FALSE(sentence_of(why, job, machine, kNow_ms).empty());
      }
    }
  }
  EXPECT_EQ(seen.size(), static_cast<std::size_t>(WhyNot::GoesElsewhere) + 1) << "every reason came up";
}

}  // namespace
}  // namespace telefab::fleet
