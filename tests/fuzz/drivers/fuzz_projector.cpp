// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <telefab/fab/drivers/dlpc900_projector.hpp>

namespace {

using namespace telefab;
using namespace telefab::fab;
using namespace std::chrono_literals;

/// What the last commands of each kind ordered.
struct Ordered {
  std::uint8_t leds = dlpc900::kLedsOff;
  std::uint8_t sequence = dlpc900::kStop;
  bool may_light = false;  ///< within expose() or behind it
};

/// A device that answers each question with the next bytes of the input: how many reports, whose sequence number, which
/// flags, which data. Out of bytes: everything is well.
class LyingUsb final : public UsbTransport {
 public:
  LyingUsb(std::deque<std::uint8_t>& bytes, Ordered& ordered, Clock& clock)
      : bytes_{bytes}, ordered_{ordered}, clock_{clock} {}

  Result<void> write(std::uint8_t, std::span<const std::byte> sent, Milliseconds) override {
    clock_.sleep_for(1ms);
    if (sent.size() < 6) std::abort();
    flags_ = static_cast<std::uint8_t>(sent[0]);
    sequence_ = static_cast<std::uint8_t>(sent[1]);
    command_ =
        static_cast<dlpc900::Command>(static_cast<std::uint8_t>(sent[4]) | static_cast<std::uint8_t>(sent[5]) << 8);
    const bool reads = (flags_ & 0x80) != 0;
    if (!reads && sent.size() > 6) {
      const auto value = static_cast<std::uint8_t>(sent[6]);
      if (command_ == dlpc900::Command::LedEnable) ordered_.leds = value;
      if (command_ == dlpc900::Command::PatternStartStop) ordered_.sequence = value;
      if ((ordered_.leds != dlpc900::kLedsOff || ordered_.sequence == dlpc900::kStart) && !ordered_.may_light)
        std::abort();
      // One pattern, shown once: the device itself ends it.
      if (command_ == dlpc900::Command::PatternConfiguration && !(sent[6] == std::byte{1} && sent[8] == std::byte{1}))
        std::abort();
    }
    return {};
  }
  Result<std::vector<std::byte>> read(std::uint8_t, std::size_t max_bytes, Milliseconds timeout) override {
    clock_.sleep_for(1ms);
    switch (bytes_.empty() ? 0 : next() % 8) {
      case 1:
        clock_.sleep_for(timeout);
        return fail(ErrorCode::DeviceTimeout, "no answer");
      case 2:
        return fail(ErrorCode::DeviceLost, "gone");
      case 3:
        return fail(ErrorCode::DeviceRefused, "halted");
      case 4: {
        std::vector<std::byte> report(next() % (max_bytes + 1));
        for (auto& b : report) b = std::byte{next()};
        return report;
      }
      case 5:
        return reply(static_cast<std::uint8_t>(flags_ | (next() & 0x20)), static_cast<std::uint8_t>(sequence_ + next()),
                     max_bytes);
      default:
        return reply(flags_, sequence_, max_bytes);
    }
  }
  Result<void> clear_halt(std::uint8_t) override { return {}; }
  Result<void> reopen() override { return {}; }
  std::string describe() const override { return "a device that says anything"; }

 private:
  std::uint8_t next() {
    if (bytes_.empty()) return 0;
    const std::uint8_t b = bytes_.front();
    bytes_.pop_front();
    return b;
  }
  /// What a sound device would say, with each byte replaced by the input's where it says so.
  std::vector<std::byte> reply(std::uint8_t flags, std::uint8_t sequence, std::size_t max_bytes) {
    std::vector<std::byte> data;
    const auto put = [&](std::initializer_list<int> values) {
      for (const int v : values) data.push_back(static_cast<std::byte>(v));
    };
    using enum dlpc900::Command;
    if (command_ == Version)
      put({0, 0, 0, 6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
    else if (command_ == DmdType)
      put({1});
    else if (command_ == HardwareStatus)
      put({dlpc900::kHardwareInitOk});
    else if (command_ == SystemStatus)
      put({dlpc900::kSystemMemoryOk});
    else if (command_ == MainStatus)
      put({0});
    else if (command_ == DisplayMode)
      put({dlpc900::kModeOnTheFly});
    else if (command_ == LedEnable)
      put({ordered_.leds});
    else if (command_ == LedCurrent)
      put({0, 0, 10});
    else
      put({0});
    if (!bytes_.empty() && next() % 4 == 0)
      for (auto& b : data)
        if (!bytes_.empty()) b = std::byte{next()};
    std::vector<std::byte> report(dlpc900::kReportBytes);
    report[0] = std::byte{flags};
    report[1] = std::byte{sequence};
    report[2] = static_cast<std::byte>(data.size());
    std::copy_n(data.begin(), std::min(data.size(), report.size() - 4), report.begin() + 4);
    report.resize(std::min(max_bytes, report.size()));
    return report;
  }
  std::deque<std::uint8_t>& bytes_;
  Ordered& ordered_;
  Clock& clock_;
  std::uint8_t flags_ = 0, sequence_ = 0;
  dlpc900::Command command_{};
};

}  // namespace

// A projector that answers anything: lit only within an exposure, each shown once, and told to be dark at the end.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::deque<std::uint8_t> bytes{data, data + size};
  Ordered ordered;
  VirtualClock clock;
  const Dlpc900Options options{.mask = {16, 8}, .led_current = 10};
  {
    auto made = Dlpc900Projector::open(std::make_unique<LyingUsb>(bytes, ordered, clock), options, clock);
    if (!made) {
      if (made.error().what.empty()) std::abort();
    } else {
      Dlpc900Projector& projector = **made;
      Mask mask{{16, 8}, std::vector<std::uint8_t>(128, 200)};
      if (projector.load(mask.view(), {200ms})) {
        for (int i = 0; i < 200; ++i) {
          const auto status = projector.poll();
          if (!status) break;
          if (status->state == LightState::Loaded) {
            ordered.may_light = true;
            if (!projector.expose()) break;
          }
          if (status->state == LightState::Exposed) {
            if (ordered.leds != dlpc900::kLedsOff) std::abort();
            break;
          }
          clock.sleep_for(10ms);
        }
      }
    }
  }
  if (ordered.leds != dlpc900::kLedsOff || ordered.sequence == dlpc900::kStart) std::abort();
  if (clock.now() > 30min) std::abort();
  return 0;
}
