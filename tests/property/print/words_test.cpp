// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <map>
#include <random>
#include <set>
#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/print/print_word.hpp>
#include <telefab/fab/print/start_rule.hpp>
#include <telefab/test/print_rig.hpp>

// Operators who approve, pause, cancel, resume and stop a print that is killed between any two of its operations, those
// of an approval among them, on a disk that fills, with journals put back from a backup, bits that change and a clock
// that jumps. The devices live on and are the recorder: no light before somebody has said to print, and none after an
// answered pause or cancel without a later resume; no layer is lit twice or left out without an operator's decision.
// TELEFAB_WORDS says how many prints (default 400; the campaign takes 10,000).

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::FormulaMasks;

constexpr PixelSize kSize{24, 16};
constexpr std::uint32_t kLayers = 5;
constexpr Nanoseconds kExposure = 700ms;
constexpr int kLives = 16;
constexpr unsigned kApprovalOperations = 8;  ///< about as many as an approval takes

struct Killed {};

/// What a life of the site does, counted; at one of these operations something happens.
struct Operations {
  std::uint64_t count = 0;
  std::map<std::uint64_t, std::function<void()>> at;
  void operation() {
    const auto due = at.find(count++);
    if (due != at.end()) due->second();
  }
};

/// A disk: what was synced survives, of the rest a random beginning.
struct Disk {
  std::string safe, unsafe;
  bool is_full = false;
  [[nodiscard]] std::string text() const { return safe + unsafe; }
  void crash(std::mt19937_64& rng) {
    safe += unsafe.substr(0, rng() % (unsafe.size() + 1));
    unsafe.clear();
  }
};

class DiskFile final : public JournalFile {
 public:
  DiskFile(Disk& disk, Operations& operations) : disk_{disk}, operations_{operations} {}
  Result<std::string> read_all() override { return disk_.text(); }
  Result<void> append(std::string_view text) override {
    operations_.operation();
    if (disk_.is_full) {
      disk_.unsafe += text.substr(0, text.size() / 3);
      return fail(ErrorCode::StorageFailed, "the disk is full");
    }
    disk_.unsafe += text;
    operations_.operation();
    return {};
  }
  Result<void> sync() override {
    operations_.operation();
    disk_.safe += std::exchange(disk_.unsafe, {});
    operations_.operation();
    return {};
  }
  Result<void> truncate(std::uint64_t bytes) override {
    disk_.safe = disk_.text().substr(0, bytes);
    disk_.unsafe.clear();
    return {};
  }
  Result<void> set_aside(std::string_view text) override {
    operations_.operation();
    if (disk_.is_full) return fail(ErrorCode::StorageFailed, "the disk is full");
    disk_.safe = text;
    disk_.unsafe.clear();
    return {};
  }
  Result<void> reserve(std::uint64_t) override { return {}; }

 private:
  Disk& disk_;
  Operations& operations_;
};

class CountedProjector final : public Projector {
 public:
  /// `on_light` is called when light is about to begin.
  CountedProjector(Projector& inner, Operations& operations, std::function<void()> on_light)
      : inner_{inner}, operations_{operations}, on_light_{std::move(on_light)} {}
  const ProjectorFacts& facts() const override { return inner_.facts(); }
  Result<void> load(const MaskView& m, const LightOrder& light) override {
    operations_.operation();
    return inner_.load(m, light);
  }
  Result<void> expose() override {
    operations_.operation();
    on_light_();
    auto lit = inner_.expose();
    operations_.operation();
    return lit;
  }
  Result<ProjectorStatus> poll() override { return inner_.poll(); }
  Result<void> dark() override {
    operations_.operation();
    return inner_.dark();
  }
  Nanoseconds load_time(const MaskView& m) const override { return inner_.load_time(m); }

 private:
  Projector& inner_;
  Operations& operations_;
  std::function<void()> on_light_;
};

/// The wall clock jumps; the monotonic one does not.
class JumpingClock final : public Clock {
 public:
  JumpingClock(VirtualClock& inner, Operations& operations, Nanoseconds& jump)
      : inner_{inner}, operations_{operations}, jump_{jump} {}
  Nanoseconds now() const override { return inner_.now(); }
  Nanoseconds wall() const override { return inner_.wall() + jump_; }
  void sleep_for(Nanoseconds d) override {
    operations_.operation();
    inner_.sleep_for(d);
  }

 private:
  VirtualClock& inner_;
  Operations& operations_;
  Nanoseconds& jump_;
};

enum class Word : std::uint8_t { Pause, Cancel, Resume, Stop };

/// A machine, its operators, and sites that come and go.
class Story {
 public:
  Story(const PrintPlan& plan, std::uint64_t seed) : plan_{plan}, rng_{seed} {}

  void play(std::map<std::string, int>& outcomes) {
    for (int life = 0; life < kLives && !is_over_; ++life) live(life + 1 == kLives);
    projector_.faults = {};
    (void)projector_.dark();
    judge();
    ++outcomes[outcome_];
    for (const auto& [what, n] : seen_) outcomes[what] += n;
  }

 private:
  [[nodiscard]] PrintJournal open() {
    auto journal = PrintJournal::open(std::make_unique<DiskFile>(disk_, no_operations_));
    EXPECT_TRUE(journal) << journal.error().what;
    return std::move(*journal);
  }
  [[nodiscard]] Nanoseconds wall() const { return clock_.wall() + jump_; }
  bool chance(unsigned of_hundred) { return rng_() % 100 < of_hundred; }

  /// A planned print waits for somebody's word; the site may die while it is given, and the disk may be full.
  void approve(bool is_last) {
    Operations operations;
    if (!is_last && chance(25)) operations.at[rng_() % kApprovalOperations] = [] { throw Killed{}; };
    if (!is_last && chance(15)) operations.at[rng_() % kApprovalOperations] = [this] { disk_.is_full = true; };
    const std::string although = chance(30) ? "islands: seen, they hold" : "";
    try {
      auto journal = PrintJournal::open(std::make_unique<DiskFile>(disk_, operations));
      ASSERT_TRUE(journal) << journal.error().what;
      const auto kept =
          keep_word(*journal, plan_, seen_by_store_, {JournalStep::Approved, "ana", although, {}}, wall());
      ++seen_[kept ? "approvals answered" : "approvals refused"];
      if (!kept) return;  // it must stay as dark as it was
      EXPECT_FALSE(cancelled_) << "an approval of a cancelled print was answered";
      dark_since_.reset();
      is_paused_in_store_ = false;
      approval_stands_ = true;
      if (chance(50)) disk_.crash(rng_);  // what was answered is not among what a crash takes
    } catch (const Killed&) {
      ++seen_["approvals killed"];
      dark_since_.reset();  // it was said, and holds where it was kept
      disk_.crash(rng_);
    }
  }

  /// Whoever approves a cancelled print is told so, and nothing lights.
  void approve_in_vain(PrintJournal& journal) {
    const auto kept = keep_word(journal, plan_, seen_by_store_, {JournalStep::Approved, "ben", {}, {}}, wall());
    ASSERT_FALSE(kept);
    EXPECT_EQ(kept.error().code, ErrorCode::Conflict);
    ++seen_["approvals after a cancel"];
  }

  /// One life of the site: what the start rule allows, with things that happen on the way.
  void live(bool is_last) {
    disk_.is_full = false;
    Operations operations;
    std::stop_source stop;
    PrintControl control;
    PrintJournal journal = open();
    const bool begun = !journal.empty() || seen_by_store_ > LayerIndex{0};
    const StartFacts facts = facts_of(journal, plan_digest(plan_), seen_by_store_, begun, is_paused_in_store_);
    const StartVerdict verdict = may_light_at_start(facts, begun, {}, wall());
    // By a clock that never jumped; one that did is a stated limit (decision 0807).
    EXPECT_FALSE(verdict.ruling == StartRuling::GoOn && !has_jumped_ && clock_.now() - ended_at_ > 10min)
        << "a print that hung for long went on by itself";
    EXPECT_TRUE(!approval_stands_ || facts.order.order != Order::None) << "an answered approval was lost";
    ++seen_["ruled " + std::string{name_of(verdict.reason)}];
    if (verdict.ruling == StartRuling::End) {
      if (chance(20)) approve_in_vain(journal);
      return end("cancelled");
    }
    if (verdict.ruling == StartRuling::WaitForApproval) {
      if (!is_last && chance(5)) return give_to_resting(journal, {JournalStep::CancelAsked, "ana", {}, {}});
      approve(is_last);
      return after_the_end();
    }
    if (verdict.ruling != StartRuling::GoOn && verdict.ruling != StartRuling::KeepRecord) {
      is_paused_in_store_ = true;
      if (!is_last && chance(15)) return give_to_resting(journal, {JournalStep::CancelAsked, "ana", {}, {}});
      if (!give_go_on(journal, facts)) return;
      is_paused_in_store_ = false;
    }
    if (!is_last) plan_trouble(operations, stop, control);
    try {
      CountedProjector p{projector_, operations, [this] { lights_against_order_ += dark_since_.has_value(); }};
      JumpingClock c{clock_, operations, jump_};
      auto file = PrintJournal::open(std::make_unique<DiskFile>(disk_, operations));
      ASSERT_TRUE(file) << file.error().what;
      PrintRunner runner{p, stage_, masks_, *file, c};
      const auto record = runner.run(
          plan_, {}, control, [&](const PrintProgress& at) { watch(at, control, stop); }, stop.get_token());
      control.close();
      ended_at_ = clock_.now();
      if (!record) return;  // the disk was full before it began
      if (record->outcome == PrintOutcome::Done) end("done");
      if (record->outcome == PrintOutcome::Cancelled && file->order().order == Order::Cancel) end("cancelled");
      // Refused as kept nowhere, but dark and ended in memory; a start after it may go on.
      if (record->outcome == PrintOutcome::Faulted) is_paused_in_store_ = record->cause.code != ErrorCode::Cancelled;
    } catch (const Killed&) {
      ++seen_["kills"];
      control.close();
      // A resume that was said and taken holds, answered or not.
      if (std::exchange(resume_taken_, false)) dark_since_.reset();
      clock_.advance(Milliseconds{rng_() % 3000});
      disk_.crash(rng_);
    }
    after_the_end();
  }

  /// An operator has looked at the part, which the recorder is.
  bool give_go_on(PrintJournal& journal, const StartFacts& facts) {
    std::optional<Decision> decision;
    if (facts.maybe_exposed) {
      (void)projector_.dark();
      const ResumePoint point = resume_point_of(journal, seen_by_store_);
      // Layers in question may be of both kinds; then the operator takes the word that fits the first, and says so.
      const auto is_lit = [&](std::uint32_t k) { return light_of(LayerIndex{k}) > 0ns; };
      decision = is_lit(point.next.count()) ? Decision::TreatAsExposed : Decision::ExposeAgain;
      for (std::uint32_t k = 0; k < point.in_question; ++k) decided_.insert(point.next.count() + k);
      // "Exposed" speaks of every layer in question, and "dark" of all that follow the first.
      if (decision == Decision::ExposeAgain)
        for (std::uint32_t k = point.next.count(); k < kLayers; ++k)
          if (is_lit(k)) decided_.insert(k);
      ++seen_["decisions"];
    } else if (facts.is_damaged || facts.is_behind_store) {
      ++seen_["words about damage"];
    }
    const auto kept = keep_word(journal, plan_, seen_by_store_, {JournalStep::Resumed, "ana", {}, decision}, wall());
    EXPECT_TRUE(kept) << kept.error().what;
    if (kept) {
      dark_since_.reset();
      ended_at_ = clock_.now();
      ++seen_["resumed"];
    }
    return kept.has_value();
  }

  void give_to_resting(PrintJournal& journal, const PrintWord& word) {
    if (!keep_word(journal, plan_, seen_by_store_, word, wall())) return;
    cancelled_ = true;
    dark_since_ = clock_.now();
    ++seen_["cancelled at rest"];
  }

  /// Up to three of: a word, a kill, a full disk, a jump of the clock, each at a operation of its own.
  void plan_trouble(Operations& operations, std::stop_source& stop, PrintControl& control) {
    const auto when = [&] { return rng_() % 700; };
    if (chance(70)) operations.at[when()] = [] { throw Killed{}; };
    if (chance(25))
      operations.at[when()] = [this] {
        disk_.is_full = true;
        ++seen_["full disks"];
      };
    if (chance(15))
      operations.at[when()] = [this] {
        has_jumped_ = true;
        jump_ += chance(50) ? Nanoseconds{-1h} : Nanoseconds{1h};
        ++seen_["clock jumps"];
      };
    for (int n = static_cast<int>(rng_() % 3); n > 0; --n)
      operations.at[when()] = [this, &control, &stop] { give_word(control, stop); };
  }

  void give_word(PrintControl& control, std::stop_source& stop) {
    const auto word = static_cast<Word>(rng_() % 4);
    const auto kept = [this, word](const std::optional<Result<void>>& outcome) {
      if (word == Word::Resume) resume_taken_ = false;
      if (!outcome) return void(++seen_["words that came too late"]);
      if (!*outcome) return void(++seen_["words refused"]);
      ++seen_["words answered"];
      if (word == Word::Resume) return dark_since_.reset();
      dark_since_ = clock_.now();
      cancelled_ |= word == Word::Cancel;
    };
    switch (word) {
      case Word::Pause:
        return control.pause("ana", kept);
      case Word::Cancel:
        return control.cancel("ana", kept);
      case Word::Resume:
        // After an answered cancel a resume changes nothing, and no operator of this story asks for it.
        if (cancelled_) return;
        resume_taken_ = true;
        return control.resume("ana", kept);
      case Word::Stop:
        ++seen_["stops"];
        stop.request_stop();
    }
  }

  /// The store sees what the sink is told, now and then. Paused at its machine, an operator comes, or the site stops.
  void watch(const PrintProgress& at, PrintControl& control, std::stop_source& stop) {
    if (chance(60)) seen_by_store_ = at.layer;
    if (at.phase != PrintPhase::Paused) return;
    if (chance(50)) {
      stop.request_stop();
    } else {
      resume_taken_ = true;
      control.resume("ana", [this](const std::optional<Result<void>>& kept) {
        resume_taken_ = false;
        if (kept && *kept) dark_since_.reset();
      });
    }
  }

  void after_the_end() {
    if (is_over_) return;
    ended_at_ = clock_.now();
    if (chance(10)) {
      clock_.advance(20min);
      ++seen_["long outages"];
    }
    if (chance(12) && !backup_.empty() && backup_.size() < disk_.text().size() && !dark_since_) {
      restore_backup();
      approval_stands_ = false;
      ++seen_["restored backups"];
    } else if (chance(10)) {
      std::string text = disk_.text();
      if (text.empty()) return;
      approval_stands_ = false;
      text[rng_() % text.size()] ^= static_cast<char>(1U << rng_() % 7);
      disk_.safe = text;
      disk_.unsafe.clear();
      ++seen_["changed bits"];
    }
    if (chance(30)) backup_ = disk_.text();
  }

  /// What neither the older journal nor the store knows of is a stated limit (decision 0807); such layers are counted.
  void restore_backup() {
    disk_.safe = backup_;
    disk_.unsafe.clear();
    const LayerIndex known = std::max(open().resume_point().next, seen_by_store_);
    (void)projector_.dark();
    for (std::uint32_t k = known.count(); k < kLayers; ++k)
      if (light_of(LayerIndex{k}) > 0ns && lost_.insert(k).second) ++seen_["layers that only a lost journal knew"];
  }

  void end(const std::string& how) {
    is_over_ = true;
    outcome_ = how;
  }

  [[nodiscard]] Nanoseconds light_of(LayerIndex layer) const {
    Nanoseconds sum{};
    for (const LitSpan& lit : log_.light())
      if (lit.mask == plan_.layers[layer.count()].mask) sum += lit.until - lit.from;
    return sum;
  }

  void judge() {
    ASSERT_EQ(log_.light_while_moving(), 0ns);
    ASSERT_EQ(lights_against_order_, 0)
        << "light before an approval, or after an answered pause or cancel, and nobody had resumed";
    for (std::uint32_t k = 0; k < kLayers; ++k) {
      const Nanoseconds lit = light_of(LayerIndex{k});
      if (decided_.contains(k) || lost_.contains(k)) continue;
      ASSERT_LE(lit, kExposure) << "layer " << k << " was lit twice and nobody decided";
      if (outcome_ == "done") {
        ASSERT_EQ(lit, kExposure) << "layer " << k << " was left out and nobody decided";
      }
    }
  }

  const PrintPlan& plan_;
  std::mt19937_64 rng_;
  FormulaMasks masks_{kSize};
  VirtualClock clock_{1'000'000s};
  Nanoseconds jump_{};
  MachineLog log_;
  VirtualProjector projector_{kSize, 0, clock_, log_};
  VirtualZStage stage_{25, clock_, log_};
  Disk disk_;
  Operations no_operations_;
  LayerIndex seen_by_store_;
  bool is_paused_in_store_ = false;
  std::string backup_;
  /// A pause or cancel was answered then, and no resume since; from the beginning, as long as nobody has approved.
  std::optional<Nanoseconds> dark_since_ = Nanoseconds{0};
  bool resume_taken_ = false;  ///< said, and not known to be untaken or refused
  bool cancelled_ = false;
  Nanoseconds ended_at_ = clock_.now();  ///< the last life, or the last word before it
  bool has_jumped_ = false;
  bool approval_stands_ = false;  ///< answered, and the disk kept its word since
  std::set<std::uint32_t> decided_;
  std::set<std::uint32_t> lost_;
  int lights_against_order_ = 0;
  bool is_over_ = false;
  std::string outcome_ = "waits for an operator";
  std::map<std::string, int> seen_;
};

int prints_wanted() {
  const char* text = std::getenv("TELEFAB_WORDS");
  return text != nullptr ? std::max(1, std::atoi(text)) : 400;
}

TEST(Words, FromTheApprovalOnHoldThroughKillsFullDisksBackupsDamageAndClockJumps) {
  FormulaMasks masks{kSize};
  const auto exposure = std::chrono::duration_cast<Microseconds>(kExposure);
  const PrintPlan plans[] = {test::formula_plan(masks, kSize, kLayers, exposure),
                             test::formula_plan(masks, kSize, kLayers, exposure, test::every_step_and_tilt())};
  const int prints = prints_wanted();
  std::map<std::string, int> outcomes;
  for (int seed = 0; seed < prints; ++seed) {
    SCOPED_TRACE(seed);
    Story{plans[seed % 2], static_cast<std::uint64_t>(seed)}.play(outcomes);
    if (testing::Test::HasFailure()) break;
  }
  for (const auto& [what, n] : outcomes) fmt::print("{:<40} {:>7}\n", what, n);
  EXPECT_EQ(outcomes["done"] + outcomes["cancelled"] + outcomes["waits for an operator"], prints);
  EXPECT_LT(outcomes["waits for an operator"], prints / 20) << "operators get their prints done";
  for (const char* what : {"kills", "full disks", "clock jumps", "changed bits", "restored backups", "words answered",
                           "words refused", "decisions", "stops", "cancelled", "long outages", "approvals answered",
                           "approvals killed", "approvals refused", "approvals after a cancel"})
    EXPECT_GT(outcomes[what], 0) << what;
}

}  // namespace
}  // namespace telefab::fab
