// SPDX-License-Identifier: GPL-3.0-or-later
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <string>
#include <telefab/fab/drivers/grbl_stage.hpp>

namespace {

using namespace telefab;
using namespace telefab::fab;
using namespace std::chrono_literals;

constexpr double kTop_mm = 100;

/// A board that says the next line of the input whenever it is asked, and is gone when there is none left.
class LyingLine final : public LineTransport {
 public:
  LyingLine(std::string_view lines, StageDialect dialect, Clock& clock)
      : lines_{lines}, dialect_{dialect}, clock_{clock} {}

  Result<void> write(std::string_view sent, Milliseconds) override {
    if (lines_.empty()) return fail(ErrorCode::DeviceLost, "the input is over");
    if (const std::size_t at = sent.find("M118 "); at != std::string_view::npos)
      answers_.emplace_back(sent.substr(at + 5, sent.find('\n', at) - at - 5));
    if (sent == "$#\n") answers_.insert(answers_.end(), {"[G54:0.000,0.000,0.000]", "ok"});
    // Whatever the board said before, what it is told to do makes sense.
    if (const auto at = sent.find("G1 Z"); at != std::string_view::npos) {
      double z = NAN;
      const auto [end, error] = std::from_chars(sent.data() + at + 4, sent.data() + sent.size(), z);
      if (error != std::errc{} || !(std::abs(z) < 100'000)) std::abort();
    }
    return {};
  }
  Result<std::optional<std::string>> read_line(Milliseconds) override {
    clock_.sleep_for(1ms);  // a line takes its time
    if (!announced_) {
      announced_ = true;
      return std::optional<std::string>{dialect_ == StageDialect::Grbl ? "Grbl 1.1h ['$' for help]" : "start"};
    }
    if (!answers_.empty()) {
      std::string answer = std::move(answers_.front());
      answers_.pop_front();
      return std::optional<std::string>{std::move(answer)};
    }
    if (lines_.empty()) return fail(ErrorCode::DeviceLost, "the input is over");
    const std::size_t end = std::min(lines_.find('\n'), lines_.size());
    std::string line{lines_.substr(0, end)};
    lines_.remove_prefix(std::min(end + 1, lines_.size()));
    if (line == "~") return std::optional<std::string>{};
    if (line == "!") return fail(ErrorCode::DeviceLost, "gone");
    return std::optional<std::string>{std::move(line)};
  }
  Result<void> reopen() override {
    announced_ = false;
    return {};
  }
  std::string describe() const override { return "a board that says anything"; }

 private:
  std::string_view lines_;
  StageDialect dialect_;
  Clock& clock_;
  std::deque<std::string> answers_;
  bool announced_ = false;
};

void run(std::string_view lines, StageDialect dialect) {
  VirtualClock clock;
  SerialStageOptions options;
  options.dialect = dialect;
  options.top_mm = kTop_mm;
  options.thermometer = dialect == StageDialect::Marlin ? Thermometer::Bed : Thermometer::None;
  auto stage = SerialStage::open(std::make_unique<LyingLine>(lines, dialect, clock), options, clock);
  if (!stage) {
    if (stage.error().what.empty()) std::abort();
    return;
  }
  double target_mm = kTop_mm;
  bool moving = false;
  if (!(*stage)->home()) return;
  for (int i = 0; i < 200; ++i) {
    const auto status = (*stage)->poll();
    if (const auto celsius = (*stage)->celsius(); celsius && *celsius && !std::isfinite(**celsius)) std::abort();
    clock.sleep_for(10ms);
    if (!status) {
      if (!(*stage)->home()) return;
      moving = false;
      target_mm = kTop_mm;
      continue;
    }
    if (!status->homed || status->moving) continue;
    if (!std::isfinite(status->z_mm)) std::abort();
    // At rest, a homed stage is where it was sent.
    if (moving && std::abs(status->z_mm - target_mm) > (*stage)->facts().steps_tolerance_mm) std::abort();
    target_mm = target_mm > kTop_mm / 2 ? 0.1 : kTop_mm - 5;
    moving = true;
    if (!(*stage)->move_to(target_mm, 5)) return;
  }
}

}  // namespace

// Lines of a GRBL or a Marlin board, whatever they say: a stage that says where it is is where it was sent.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view lines{reinterpret_cast<const char*>(data), size};
  run(lines, StageDialect::Grbl);
  run(lines, StageDialect::Marlin);
  return 0;
}
