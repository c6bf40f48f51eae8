// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string_view>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/screen/screen_display.hpp>
#include <utility>
#include <vector>

namespace telefab::test {

/// Ways a screen and its guard can fail. Each strikes at the n-th call of prepare, show, is_shown or black after it was
/// planned.
enum class DisplayFault : std::uint8_t {
  Refused,      ///< the call is refused and nothing changes
  Unconfirmed,  ///< the frame comes up, and nothing says so
  Tripped,      ///< the guard takes this program for hung: black at once, and nothing more before black()
  Lost,         ///< connection to the guard lost: black at once; all calls fail until the second black()
};
inline constexpr std::size_t kDisplayFaults = 4;
[[nodiscard]] inline std::string_view name_of(DisplayFault fault) {
  constexpr std::string_view names[] = {"refused", "unconfirmed", "tripped", "lost"};
  return names[static_cast<std::size_t>(fault)];
}

/// A screen on a clock, that writes down what it showed; it outlives the program that drives it.
class ScreenModel {
 public:
  ScreenModel(PixelSize words, Clock& clock, fab::MachineLog& shows)
      : clock_{clock},
        shows_{shows},
        facts_{"model", words, 4, std::chrono::nanoseconds{16'666'667}, true},
        hidden_(std::size_t{words.width_px} * words.height_px * 4),
        prepared_{hidden_} {}

  void plan_fault(DisplayFault fault, std::uint64_t calls_from_now) { fault_ = {fault, calls_ + calls_from_now}; }
  [[nodiscard]] std::uint64_t calls() const { return calls_; }
  /// The program is dead: its guard sees that and darkens.
  void client_died() { end(clock_.now()); }
  void repair() { fails_ = 0; }
  void tick() {
    if (until_ && clock_.now() >= *until_) end(*until_);
  }

  [[nodiscard]] const fab::DisplayFacts& facts() const { return facts_; }
  [[nodiscard]] std::span<std::byte> hidden() { return hidden_; }
  Result<void> prepare() {
    if (const auto ok = call(); !ok) return ok;
    prepared_ = hidden_;
    return {};
  }
  Result<void> show(Nanoseconds at_most) {
    const auto ok = call();
    if (!ok && !comes_up_) return ok;
    clock_.sleep_for(facts_.frame / 2);
    shown_ = digest_of(std::span<const std::byte>{prepared_});
    from_ = clock_.now();
    until_ = from_ + at_most;
    return ok;
  }
  Result<bool> is_shown() {
    if (const auto ok = call(); !ok) return tl::unexpected{ok.error()};
    return until_.has_value();
  }
  Result<void> black() {
    const auto ok = call();
    if (ok) end(clock_.now());
    return ok;
  }

 private:
  Result<void> call() {
    tick();
    comes_up_ = false;
    const std::uint64_t n = calls_++;
    if (fault_ && fault_->second == n) {
      const DisplayFault fault = std::exchange(fault_, {})->first;
      comes_up_ = fault == DisplayFault::Unconfirmed;
      if (fault == DisplayFault::Tripped || fault == DisplayFault::Lost) end(clock_.now());
      if (fault == DisplayFault::Lost) fails_ = 2;
      if (fault == DisplayFault::Tripped || fault == DisplayFault::Refused || comes_up_)
        return fail(ErrorCode::DeviceTimeout, std::string{"model display: "} + std::string{name_of(fault)});
    }
    if (fails_ > 0) {
      --fails_;
      return fail(ErrorCode::DeviceLost, "model display: lost");
    }
    return {};
  }
  void end(Nanoseconds at) {
    if (!until_) return;
    shows_.lit({from_, std::min(at, *until_), shown_, 0, 1});
    until_.reset();
  }

  Clock& clock_;
  fab::MachineLog& shows_;
  fab::DisplayFacts facts_;
  std::vector<std::byte> hidden_, prepared_;
  Digest shown_;
  Nanoseconds from_{};
  std::optional<Nanoseconds> until_;
  std::optional<std::pair<DisplayFault, std::uint64_t>> fault_;
  std::uint64_t calls_ = 0;
  int fails_ = 0;
  bool comes_up_ = false;
};

/// A program's end of it.
class ModelDisplay final : public fab::ScreenDisplay {
 public:
  explicit ModelDisplay(ScreenModel& model) : model_{model} {}
  const fab::DisplayFacts& facts() const override { return model_.facts(); }
  std::span<std::byte> hidden() override { return model_.hidden(); }
  Result<void> prepare() override { return model_.prepare(); }
  Result<void> show(Nanoseconds at_most) override { return model_.show(at_most); }
  Result<bool> is_shown() override { return model_.is_shown(); }
  Result<void> black() override { return model_.black(); }

 private:
  ScreenModel& model_;
};

}  // namespace telefab::test
