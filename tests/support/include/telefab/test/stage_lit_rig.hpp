// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <telefab/fab/drivers/marlin_model.hpp>
#include <telefab/fab/drivers/stage_lit_projector.hpp>
#include <telefab/fab/screen/screen_projector.hpp>
#include <telefab/test/model_display.hpp>
#include <telefab/test/print_rig.hpp>

namespace telefab::test {

/// Whether the program is alive; what is dead reaches no device any more, not even by its destructors.
struct Life {
  bool is_over = false;
  std::uint64_t left = UINT64_MAX;  ///< operations until it ends
  std::uint64_t operations = 0;
  struct End {};
  void operation() {
    if (is_over) return;
    ++operations;
    if (left-- == 0) {
      is_over = true;
      throw End{};
    }
  }
};

/// A line that a dead program cannot write to.
class MortalLine final : public fab::LineTransport {
 public:
  MortalLine(fab::LineModel& model, Clock& clock, Life& life) : line_{model, clock}, life_{life} {}
  Result<void> write(std::string_view bytes, fab::Milliseconds timeout) override {
    life_.operation();
    if (life_.is_over) return dead();
    const auto done = line_.write(bytes, timeout);
    life_.operation();
    return done;
  }
  Result<std::optional<std::string>> read_line(fab::Milliseconds timeout) override {
    if (life_.is_over) return tl::unexpected{dead().value()};
    return line_.read_line(timeout);
  }
  Result<void> reopen() override {
    life_.operation();
    if (life_.is_over) return dead();
    return line_.reopen();
  }
  std::string describe() const override { return line_.describe(); }

 private:
  static tl::unexpected<Error> dead() { return fail(ErrorCode::DeviceLost, "the program is dead"); }
  fab::ModelLine line_;
  Life& life_;
};

/// A bus that a dead program cannot write to.
class MortalUsb final : public fab::UsbTransport {
 public:
  MortalUsb(fab::Dlpc900Model& model, Clock& clock, Life& life) : usb_{model, clock}, life_{life} {}
  Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes, fab::Milliseconds timeout) override {
    life_.operation();
    if (life_.is_over) return fail(ErrorCode::DeviceLost, "the program is dead");
    return usb_.write(endpoint, bytes, timeout);
  }
  Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t most, fab::Milliseconds timeout) override {
    if (life_.is_over) return fail(ErrorCode::DeviceLost, "the program is dead");
    return usb_.read(endpoint, most, timeout);
  }
  Result<void> clear_halt(std::uint8_t endpoint) override {
    if (life_.is_over) return fail(ErrorCode::DeviceLost, "the program is dead");
    return usb_.clear_halt(endpoint);
  }
  Result<void> reopen() override {
    if (life_.is_over) return fail(ErrorCode::DeviceLost, "the program is dead");
    return usb_.reopen();
  }
  std::string describe() const override { return usb_.describe(); }

 private:
  fab::ModelUsb usb_;
  Life& life_;
};

class MortalDisplay final : public fab::ScreenDisplay {
 public:
  MortalDisplay(ScreenModel& model, Life& life) : display_{model}, life_{life} {}
  const fab::DisplayFacts& facts() const override { return display_.facts(); }
  std::span<std::byte> hidden() override { return display_.hidden(); }
  Result<void> prepare() override {
    return pass([&] { return display_.prepare(); });
  }
  Result<void> show(Nanoseconds at_most) override {
    return pass([&] { return display_.show(at_most); });
  }
  Result<bool> is_shown() override {
    return pass([&] { return display_.is_shown(); });
  }
  Result<void> black() override {
    return pass([&] { return display_.black(); });
  }

 private:
  template <class F>
  auto pass(F call) -> decltype(call()) {
    life_.operation();
    if (life_.is_over) return fail(ErrorCode::DeviceLost, "the program is dead");
    return call();
  }
  ModelDisplay display_;
  Life& life_;
};

class MortalClock final : public Clock {
 public:
  MortalClock(VirtualClock& inner, Life& life) : inner_{inner}, life_{life} {}
  Nanoseconds now() const override { return inner_.now(); }
  Nanoseconds wall() const override { return inner_.wall(); }
  void sleep_for(Nanoseconds d) override {
    life_.operation();
    inner_.sleep_for(d);
  }

 private:
  VirtualClock& inner_;
  Life& life_;
};

enum class ShownBy : std::uint8_t { Screen, Dlpc900 };
enum class LitBy : std::uint8_t { GrblSpindle, MarlinFan, MarlinPin };

/// A composed light engine on models: something that shows the mask, and the lamp at the pin of the stage's board. The
/// models outlive the drivers, as real devices outlive a daemon.
struct StageLitRig {
  StageLitRig(ShownBy shows, LitBy lit, std::uint32_t layers, fab::Microseconds exposure = 700ms)
      : shown_by{shows},
        lit_by{lit},
        marlin{kTop_mm, clock, &log, {}, {lit == LitBy::MarlinFan, lit == LitBy::MarlinFan ? 0u : 9u}},
        plan{formula_plan(masks, kSize, layers, exposure)} {
    dlpc900.add_up_dose(false);
    dlpc900.record_shows(shows_log);
  }

  Result<void> connect() {
    projector.reset();
    stage.reset();
    fab::SerialStageOptions options{.top_mm = kTop_mm, .homing_mm_per_s = 20};
    options.dialect = lit_by == LitBy::GrblSpindle ? fab::StageDialect::Grbl : fab::StageDialect::Marlin;
    options.light = fab::BoardLight{.command = lit_by == LitBy::GrblSpindle ? LightCommand::Spindle
                                               : lit_by == LitBy::MarlinFan ? LightCommand::Fan
                                                                            : LightCommand::Pin,
                                    .number = lit_by == LitBy::MarlinPin ? 9u : 0u,
                                    .packet_bytes = lit_by == LitBy::MarlinPin ? 64u : 32u};
    fab::LineModel& board = lit_by == LitBy::GrblSpindle ? static_cast<fab::LineModel&>(grbl) : marlin;
    auto line = std::make_unique<MortalLine>(board, clock, life);
    if (const auto ok = line->reopen(); !ok) return ok;  // as open_tty does
    auto s = fab::SerialStage::open(std::move(line), options, mortal_clock);
    if (!s) return tl::unexpected{s.error()};
    std::unique_ptr<fab::Projector> picture;
    if (shown_by == ShownBy::Screen) {
      auto p = fab::ScreenProjector::open(std::make_unique<MortalDisplay>(screen, life),
                                          {kSize, {kSize, {}, {}, {}}, 3}, mortal_clock);
      if (!p) return tl::unexpected{p.error()};
      picture = std::move(*p);
    } else {
      auto p =
          fab::Dlpc900Projector::open(std::make_unique<MortalUsb>(dlpc900, clock, life), {.mask = kSize}, mortal_clock);
      if (!p) return tl::unexpected{p.error()};
      picture = std::move(*p);
    }
    auto engine = fab::StageLitProjector::open(std::move(picture), **s, mortal_clock);
    if (!engine) return tl::unexpected{engine.error()};
    stage = std::move(*s);
    projector = std::move(*engine);
    return {};
  }
  Result<fab::PrintRecord> print(const fab::PrintPolicy& policy = {}, const fab::PrintSink& sink = {}) {
    fab::PrintRunner runner{*projector, *stage, masks, journal, mortal_clock};
    return runner.run(plan, policy, control, sink, {});
  }
  /// The program is killed; its devices go on by themselves.
  void bury() {
    life.is_over = true;
    projector.reset();
    stage.reset();
    screen.client_died();
    life = {};
  }
  void tick() {
    grbl.tick();
    marlin.tick();
    dlpc900.tick();
    screen.tick();
  }
  [[nodiscard]] const fab::ModelLamp& lamp() const {
    return lit_by == LitBy::GrblSpindle ? grbl.lamp() : marlin.lamp();
  }
  [[nodiscard]] std::uint64_t lines() const { return lit_by == LitBy::GrblSpindle ? grbl.lines() : marlin.lines(); }
  /// As the picture shows it.
  [[nodiscard]] Digest digest_shown(LayerIndex layer) {
    const fab::Mask mask = *masks.mask(layer);
    if (shown_by == ShownBy::Dlpc900) {
      static std::map<std::uint32_t, Digest> kept;  // digests of two million mirrors are slow
      const auto [at, is_first] = kept.try_emplace(layer.count());
      if (is_first) {
        const fab::Mask mirrors = fab::place_on_mirrors(mask.view(), dlpc900.mirrors(), OpticsTurn::Normal);
        at->second = digest_of(std::as_bytes(std::span{mirrors.rows}));
      }
      return at->second;
    }
    std::vector<std::byte> frame(std::size_t{kSize.width_px} * kSize.height_px * 4);
    EXPECT_TRUE(fab::pack_mask(mask.view(), {kSize, {}, {}, {}}, frame, kSize.width_px * 4));
    return digest_of(std::span<const std::byte>{frame});
  }
  /// The time for which the lamp shone through that layer's mask.
  [[nodiscard]] Nanoseconds light_of(LayerIndex layer) {
    const Digest want = digest_shown(layer);
    Nanoseconds sum{};
    for (const fab::LitSpan& lit : log.light())
      for (const fab::LitSpan& shown : shows_log.light())
        if (shown.mask == want)
          sum += std::max(Nanoseconds{}, std::min(lit.until, shown.until) - std::max(lit.from, shown.from));
    return sum;
  }

  static constexpr PixelSize kSize{48, 32};
  static constexpr double kTop_mm = 25;
  ShownBy shown_by;
  LitBy lit_by;
  Life life;
  VirtualClock clock;
  MortalClock mortal_clock{clock, life};
  fab::MachineLog log;        ///< the lamp and the stage
  fab::MachineLog shows_log;  ///< the picture
  fab::GrblModel grbl{kTop_mm, clock, &log};
  fab::MarlinModel marlin;
  ScreenModel screen{kSize, clock, shows_log};
  fab::Dlpc900Model dlpc900{1, 6, clock, nullptr};
  FormulaMasks masks{kSize};
  fab::PrintPlan plan;
  fab::PrintJournal journal = *fab::PrintJournal::open(fab::memory_journal_file());
  fab::PrintControl control;
  std::unique_ptr<fab::SerialStage> stage;
  std::unique_ptr<fab::Projector> projector;  ///< ends before the stage that lights it
};

}  // namespace telefab::test
