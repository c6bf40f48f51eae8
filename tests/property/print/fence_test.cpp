// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/test/print_rig.hpp>

// Two fabs of a fleet and one job. A fab is killed between any two operations of its print, its line to the fleet goes
// and comes, its lease runs out and the job is given to the other, the first comes back and goes on with what its
// journal says. The devices live on and are the recorder: once a layer was lit on one of them nothing is lit on the
// other, and no layer is lit twice. TELEFAB_FENCES says how many jobs (default 600).

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::FormulaMasks;

constexpr PixelSize kSize{24, 16};
constexpr std::uint32_t kLayers = 4;
constexpr int kLives = 14;

struct Killed {};

/// What the fleet knows of the job.
struct Fleet {
  std::uint32_t attempt = 1;
  std::size_t holder = 0;
  bool is_bound = false;
};

class Story {
 public:
  explicit Story(std::uint64_t seed)
      : rng_{seed}, masks_{kSize}, plan_{test::formula_plan(masks_, kSize, kLayers, 700ms)} {}

  void play(std::map<std::string, int>& seen) {
    for (int life = 0; life < kLives; ++life) live(rng_() % 2, life + 2 >= kLives);
    live(fleet_.holder, true);
    std::map<std::string, int> lit;
    std::size_t lit_by = 0;
    for (Fab& fab : fabs_) {
      (void)fab.projector.dark();
      const auto light = fab.log.light();
      lit_by += light.empty() ? 0 : 1;
      for (const LitSpan& span : light) ++lit[to_hex(span.mask)];
    }
    EXPECT_LE(lit_by, 1U) << "lit on both";
    for (const auto& [mask, times] : lit) EXPECT_EQ(times, 1) << "a layer was lit twice";
    EXPECT_EQ(lit.size(), kLayers) << "the last lives were undisturbed";
    for (const auto& [what, times] : seen_) seen[what] += times;
  }

 private:
  struct Fab {
    VirtualClock clock;
    MachineLog log;
    VirtualProjector projector{kSize, 0, clock, log};
    VirtualZStage stage{25, clock, log};
    std::map<std::uint32_t, std::string> journals;  ///< by attempt: each is a job of its own here
    std::uint32_t newest = 0;                       ///< attempt that it has seen
  };

  /// What an agent of the fleet would tell the print; the line is asked at every question.
  class Fence final : public LightFence {
   public:
    Fence(Story& story, std::size_t fab, std::uint32_t attempt) : story_{story}, fab_{fab}, attempt_{attempt} {}
    std::uint32_t attempt() const override { return attempt_; }
    Leave leave(LayerIndex) override {
      if (attempt_ < story_.fabs_[fab_].newest) return {LeaveState::Refused, FenceRefusal::Superseded, "newer"};
      if (is_bound_) return {};
      if (story_.is_away_) return {LeaveState::Awaited, FenceRefusal::None, "away"};
      if (story_.fleet_.attempt != attempt_) return {LeaveState::Refused, FenceRefusal::LeaseEnded, "not its"};
      story_.fleet_.is_bound = is_bound_ = true;
      return {};
    }

   private:
    Story& story_;
    std::size_t fab_;
    std::uint32_t attempt_;
    bool is_bound_ = false;  // a new life asks the fleet again
  };

  class Hooked final : public Projector {
   public:
    Hooked(Projector& inner, std::function<void()> operation) : inner_{inner}, operation_{std::move(operation)} {}
    const ProjectorFacts& facts() const override { return inner_.facts(); }
    Result<void> load(const MaskView& m, const LightOrder& light) override {
      operation_();
      return inner_.load(m, light);
    }
    Result<void> expose() override {
      operation_();
      auto lit = inner_.expose();
      operation_();
      return lit;
    }
    Result<ProjectorStatus> poll() override { return inner_.poll(); }
    Result<void> dark() override { return inner_.dark(); }
    Nanoseconds load_time(const MaskView& m) const override { return inner_.load_time(m); }

   private:
    Projector& inner_;
    std::function<void()> operation_;
  };

  bool chance(unsigned of_hundred) { return rng_() % 100 < of_hundred; }

  /// Something happens to the fleet between two operations of a print.
  void disturb() {
    if (chance(6)) is_away_ = !is_away_;
    if (chance(8) && !fleet_.is_bound) {  // the lease ran out
      fleet_.holder = 1 - fleet_.holder;
      ++fleet_.attempt;
      if (chance(70)) fabs_[fleet_.holder].newest = fleet_.attempt;  // else it hears of it later
      ++seen_["given to the other"];
    }
    if (chance(5)) throw Killed{};
  }

  /// A life of one fab: it goes on with the newest attempt that it has, or its own older one where it knows no better.
  void live(std::size_t at, bool is_calm) {
    Fab& fab = fabs_[at];
    if (is_calm) is_away_ = false;
    if (fleet_.holder == at) fab.newest = fleet_.attempt;
    if (fab.newest == 0) return;
    const std::uint32_t attempt =
        is_calm || chance(60) ? fab.newest : static_cast<std::uint32_t>(1 + rng_() % fab.newest);
    Fence fence{*this, at, attempt};
    auto journal = PrintJournal::open(memory_journal_file(fab.journals[attempt])).value();
    const auto disturb_now = [&] {
      if (!is_calm) disturb();
    };
    Hooked projector{fab.projector, disturb_now};
    PrintPolicy policy;
    policy.longest_leave = 200ms;
    // The recorder knows what an operator would see.
    const ResumePoint point = journal.resume_point();
    if (point.maybe_exposed) {
      const auto light = fab.log.light();
      const bool was_lit = std::ranges::any_of(
          light, [&](const LitSpan& span) { return span.mask == plan_.layers[point.next.count()].mask; });
      policy.maybe_exposed = was_lit ? Decision::TreatAsExposed : Decision::ExposeAgain;
    }
    PrintControl control;
    const std::size_t before = fab.log.light().size();
    try {
      PrintRunner runner{projector, fab.stage, masks_, journal, fab.clock, nullptr, &fence};
      const auto record = runner.run(plan_, policy, control, {}, {});
      ASSERT_TRUE(record) << record.error().what;
      ++seen_[record->withheld == FenceRefusal::None ? std::string{name_of(record->outcome)}
                                                     : std::string{name_of(record->withheld)}];
    } catch (const Killed&) {
      ++seen_["killed"];
      fab.clock.sleep_for(2s);  // its light ends by the device's own clock
      (void)fab.projector.poll();
    }
    const bool may_have_lit = fleet_.is_bound && fleet_.holder == at && attempt == fleet_.attempt;
    EXPECT_TRUE(may_have_lit || fab.log.light().size() == before) << "lit what was not its own";
  }

  std::mt19937_64 rng_;
  FormulaMasks masks_;
  PrintPlan plan_;
  Fleet fleet_;
  bool is_away_ = false;
  std::array<Fab, 2> fabs_;
  std::map<std::string, int> seen_;
};

TEST(FenceProperty, NoLayerIsLitOnTwoFabsNorTwiceWhateverTheFleetDoes) {
  const char* asked = std::getenv("TELEFAB_FENCES");
  const int stories = asked == nullptr ? 600 : std::atoi(asked);
  std::map<std::string, int> seen;
  for (int seed = 1; seed <= stories; ++seed) {
    SCOPED_TRACE(seed);
    Story{std::uint64_t(seed)}.play(seen);
    if (HasFailure()) break;
  }
  for (const char* what : {"done", "killed", "superseded", "lease-ended", "unanswered", "given to the other"})
    EXPECT_GT(seen[what], stories / 20) << what;
  for (const auto& [what, times] : seen) RecordProperty(what, times);
}

}  // namespace
}  // namespace telefab::fab
