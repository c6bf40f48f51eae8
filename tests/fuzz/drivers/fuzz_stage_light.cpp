// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <string>
#include <telefab/fab/drivers/grbl_stage.hpp>

namespace {

using namespace telefab;
using namespace telefab::fab;
using namespace std::chrono_literals;

constexpr double kTop_mm = 100;
constexpr std::size_t kPacket_bytes = 32;

/// Whether the last word of some lines that a board was sent is light.
bool ends_lit(std::string_view sent) {
  bool lit = false;
  while (!sent.empty()) {
    const std::size_t end = std::min(sent.find('\n'), sent.size());
    const std::string_view line = sent.substr(0, end);
    sent.remove_prefix(std::min(end + 1, sent.size()));
    if (line.find("M3") != std::string_view::npos || line.starts_with("M106")) lit = true;
    if (line == "M5" || line.starts_with("M107")) lit = false;
  }
  return lit;
}

/// A board that says the next line of the input whenever it is asked, and is gone when there is none left.
class LyingLine final : public LineTransport {
 public:
  LyingLine(std::string_view lines, Clock& clock) : lines_{lines}, clock_{clock} {}

  Result<void> write(std::string_view sent, Milliseconds) override {
    if (lines_.empty()) return fail(ErrorCode::DeviceLost, "the input is over");
    // Whatever the board said before: no light without its end, and that in one packet behind a dwell.
    if (ends_lit(sent)) std::abort();
    const bool lights = sent.find("M3S") != std::string_view::npos || sent.find("M106") != std::string_view::npos;
    if (lights && (sent.size() > kPacket_bytes || !sent.starts_with("G4P"))) std::abort();
    return {};
  }
  Result<std::optional<std::string>> read_line(Milliseconds) override {
    clock_.sleep_for(1ms);  // a line takes its time
    if (lines_.empty()) return fail(ErrorCode::DeviceLost, "the input is over");
    const std::size_t end = std::min(lines_.find('\n'), lines_.size());
    std::string line{lines_.substr(0, end)};
    lines_.remove_prefix(std::min(end + 1, lines_.size()));
    if (line == "~") return std::optional<std::string>{};
    if (line == "!") return fail(ErrorCode::DeviceLost, "gone");
    return std::optional<std::string>{std::move(line)};
  }
  Result<void> reopen() override { return {}; }
  std::string describe() const override { return "a board that says anything"; }

 private:
  std::string_view lines_;
  Clock& clock_;
};

void run(std::string_view lines, StageDialect dialect) {
  VirtualClock clock;
  SerialStageOptions options;
  options.dialect = dialect;
  options.top_mm = kTop_mm;
  options.light = BoardLight{.command = dialect == StageDialect::Grbl ? LightCommand::Spindle : LightCommand::Fan};
  auto stage = SerialStage::open(std::make_unique<LyingLine>(lines, clock), options, clock);
  if (!stage || !(*stage)->home()) return;
  const LightOrder order{Microseconds{500ms}, 1};
  for (int i = 0; i < 100; ++i) {
    const auto status = (*stage)->poll();
    clock.sleep_for(10ms);
    if (!status || !status->homed || status->moving) continue;
    const Nanoseconds from = clock.now();
    if (!(*stage)->light(order)) {
      if (!(*stage)->unlight()) return;
      continue;
    }
    Result<StageLightStatus> light = StageLightStatus{};
    while ((light = (*stage)->poll_light()) && !light->is_over) {
      clock.sleep_for(10ms);
      if (clock.now() - from > 20s) std::abort();  // an exposure without an end
    }
    // Over before its time it is no exposure.
    if (light && clock.now() - from < Nanoseconds{order.duration}) std::abort();
    if (!light && !(*stage)->unlight()) return;
  }
}

}  // namespace

// Lines of a GRBL or a Marlin board, whatever they say: it is never sent a light without its end, and what passes for
// an exposure has lasted.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view lines{reinterpret_cast<const char*>(data), size};
  run(lines, StageDialect::Grbl);
  run(lines, StageDialect::Marlin);
  return 0;
}
