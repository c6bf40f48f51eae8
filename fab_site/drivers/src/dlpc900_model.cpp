// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/drivers/dlpc900_image.hpp>
#include <telefab/fab/drivers/dlpc900_model.hpp>
#include <utility>

namespace telefab::fab {

using namespace dlpc900;
using namespace std::chrono_literals;

namespace {

constexpr Nanoseconds kDeaf = 2s;
enum Refusal : std::uint8_t {
  kNone = 0,
  kDevice = 2,
  kUnknown = 3,
  kMode = 5,
  kParameter = 6,
  kMissing = 7,
  kImage = 11,
  kExposure = 14,
  kPatterns = 15,
  kDefinition = 16,
};

std::uint32_t u16(std::span<const std::byte> d, std::size_t at) {
  return static_cast<std::uint32_t>(d[at]) | static_cast<std::uint32_t>(d[at + 1]) << 8;
}
std::uint32_t u32(std::span<const std::byte> d, std::size_t at) { return u16(d, at) | u16(d, at + 2) << 16; }

}  // namespace

std::string_view name_of(ProjectorFault fault) {
  static constexpr std::string_view names[] = {
      "stall",      "error once", "error for ever",   "nak 2 s",         "short reply",  "foreign reply", "error bit",
      "lost reply", "unplug",     "controller reset", "sequencer abort", "parked stuck", "led stuck",     "slow bus"};
  static_assert(std::size(names) == kProjectorFaults);
  return names[static_cast<std::size_t>(fault)];
}

Dlpc900Model::Dlpc900Model(std::uint8_t dmd_type, std::uint8_t firmware_major, const Clock& clock, MachineLog* log,
                           LedBoard board)
    : dmd_{dmd_facts(dmd_type).value_or(*dmd_facts(1))},
      major_{firmware_major},
      clock_{clock},
      log_{log},
      board_{board} {
  hardware_ = static_cast<std::uint8_t>(kHardwareInitOk | (dmd_.two_controllers ? kHardwareSecondReady : 0));
  leds_ = kLedsOff;
}

void Dlpc900Model::plan_fault(ProjectorFault fault, std::uint64_t transfers_from_now) {
  fault_ = {fault, transfers_ + transfers_from_now};
}

UsbOutcome Dlpc900Model::strike(ProjectorFault fault) {
  switch (fault) {
    case ProjectorFault::Stall:
      halted_ = true;
      return UsbOutcome::Stall;
    case ProjectorFault::ErrorOnce:
      return UsbOutcome::Error;
    case ProjectorFault::ErrorForEver:
      broken_ = true;
      return UsbOutcome::Error;
    case ProjectorFault::Nak:
      deaf_until_ = clock_.now() + kDeaf;
      return UsbOutcome::Nak;
    case ProjectorFault::Unplug:
      gone_ = true;
      return UsbOutcome::Gone;
    case ProjectorFault::ShortReply:
    case ProjectorFault::ForeignReply:
    case ProjectorFault::LostReply:
      spoil_reply_ = fault;
      return UsbOutcome::Ok;
    case ProjectorFault::ErrorBit:
      error_bit_ = true;
      return UsbOutcome::Ok;
    case ProjectorFault::Reset:
      reset();
      return UsbOutcome::Ok;
    case ProjectorFault::SequencerAbort:
      end_run(clock_.now());
      hardware_ |= kHardwareSequencerAbort;
      return UsbOutcome::Ok;
    case ProjectorFault::ParkedStuck:
      parked_stuck_ = true;
      return UsbOutcome::Ok;
    case ProjectorFault::LedStuck:
      led_stuck_ = true;
      return UsbOutcome::Ok;
    case ProjectorFault::SlowBus:
      slow_ = true;
      return UsbOutcome::Ok;
  }
  return UsbOutcome::Ok;
}

UsbOutcome Dlpc900Model::out(std::uint8_t endpoint, std::span<const std::byte> bytes) {
  tick();
  if (endpoint != kOutEndpoint || bytes.empty() || bytes.size() % kReportBytes != 0) return UsbOutcome::Stall;
  const std::uint64_t n = transfers_++;
  if (gone_) return UsbOutcome::Gone;
  if (broken_) return UsbOutcome::Error;
  if (halted_) return UsbOutcome::Stall;
  if (fault_ && fault_->second == n) {
    const ProjectorFault fault = fault_->first;
    fault_.reset();
    if (const UsbOutcome outcome = strike(fault); outcome != UsbOutcome::Ok) return outcome;
  }
  if (clock_.now() < deaf_until_) return UsbOutcome::Nak;
  reply_.reset();  // one buffer for both ways: an unread reply is lost
  for (std::size_t at = 0; at < bytes.size(); at += kReportBytes) {
    command_.insert(command_.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    bytes.begin() + static_cast<std::ptrdiff_t>(at + kReportBytes));
    const std::size_t whole = u16(command_, 2) + 4;
    if (whole > kCommandBytes || whole < 6) {
      last_error_ = kParameter;
      ++refusals_;
      command_.clear();
      return UsbOutcome::Ok;
    }
    if (command_.size() >= whole) {
      command_.resize(whole);
      execute();
      command_.clear();
    }
  }
  return UsbOutcome::Ok;
}

UsbOutcome Dlpc900Model::in(std::uint8_t endpoint, std::vector<std::byte>& reply) {
  tick();
  if (endpoint != kInEndpoint) return UsbOutcome::Stall;
  if (gone_) return UsbOutcome::Gone;
  if (broken_) return UsbOutcome::Error;
  if (halted_) return UsbOutcome::Stall;
  if (!reply_ || clock_.now() < deaf_until_) return UsbOutcome::Nak;
  reply = std::move(*reply_);
  reply_.reset();
  return UsbOutcome::Ok;
}

void Dlpc900Model::clear_halt(std::uint8_t) {
  halted_ = false;
  command_.clear();
}

void Dlpc900Model::reopened() {
  tick();
  gone_ = broken_ = halted_ = false;
  command_.clear();
  reply_.reset();
}

void Dlpc900Model::power_cycle() {
  tick();
  led_stuck_ = parked_stuck_ = slow_ = false;
  reset();
  hardware_ &= static_cast<std::uint8_t>(~kHardwareSequencerAbort);
  reopened();
}

void Dlpc900Model::reset() {
  end_run(clock_.now());
  definition_ = configured_ = configured_since_image_ = parked_ = false;
  mode_ = 0;
  leds_ = kLedsOff;
  for (auto& half : half_) half.reset();
  for (auto& upload : upload_) upload.clear();
  expected_[0] = expected_[1] = 0;
  last_error_ = 0;
}

void Dlpc900Model::tick() {
  if (running_ && clock_.now() >= run_until_) {
    end_run(run_until_);
  }
}

std::uint8_t Dlpc900Model::glow() const {
  if (board_.enable_reaches_leds && leds_ == kLedsOff) return 0;
  std::uint8_t most = 0;
  for (const std::byte c : current_) {
    const auto current = std::to_integer<std::uint8_t>(c);
    const bool is_turned = (polarity_ == 1) != board_.inverted_pwm;
    most = std::max(most, is_turned ? static_cast<std::uint8_t>(255 - current) : current);
  }
  return most;
}

template <class Change>
void Dlpc900Model::change_leds(Change change) {
  const bool was_lit = lit();
  if (was_lit) end_light(clock_.now());
  change();
  if (!was_lit && lit()) lit_from_ = clock_.now();
}

void Dlpc900Model::end_light(Nanoseconds at) {
  if (!lit()) return;
  if (add_up_) {
    const auto seconds = static_cast<float>(double((at - lit_from_).count()) * 1e-9 / 255);
    if (dose_s_.empty()) dose_s_.resize(image_.rows.size());
    for (std::size_t i = 0; i < dose_s_.size(); ++i) dose_s_[i] += static_cast<float>(image_.rows[i]) * seconds;
  }
  if (log_ != nullptr)
    log_->lit({lit_from_, at, digest_of(std::as_bytes(std::span{image_.rows})), log_->z_mm(), glow() / 255.0});
  lit_from_ = at;
}

void Dlpc900Model::end_run(Nanoseconds at) {
  end_light(at);
  if (std::exchange(running_, false) && shows_ != nullptr)
    shows_->lit({run_from_, at, digest_of(std::as_bytes(std::span{image_.rows})), 0, 1});
}

std::vector<float> Dlpc900Model::dose_s() {
  tick();
  auto dose = dose_s_;
  dose.resize(std::size_t{dmd_.size.width_px} * dmd_.size.height_px);
  return dose;
}

void Dlpc900Model::execute() {
  const auto flags = static_cast<std::uint8_t>(command_[0]);
  const auto code = static_cast<Command>(u16(command_, 4));
  std::vector<std::byte> answer;
  const std::uint8_t refusal = std::exchange(error_bit_, false)
                                   ? std::uint8_t{kDevice}
                                   : carry_out(code, (flags & 0x80) != 0, std::span{command_}.subspan(6), answer);
  if (refusal != kNone) {
    last_error_ = refusal;
    ++refusals_;
    answer = {std::byte{refusal}};
  }
  const auto spoil = std::exchange(spoil_reply_, {});
  if ((flags & 0x40) == 0 || spoil == ProjectorFault::LostReply) return;
  std::vector<std::byte> reply(kReportBytes);
  reply[0] = std::byte(flags | (refusal != kNone ? kErrorFlag : 0));
  reply[1] = spoil == ProjectorFault::ForeignReply ? command_[1] ^ std::byte{0x55} : command_[1];
  reply[2] = std::byte(answer.size());
  std::copy(answer.begin(), answer.end(), reply.begin() + 4);
  if (spoil == ProjectorFault::ShortReply) reply.resize(3);
  reply_ = std::move(reply);
}

std::uint8_t Dlpc900Model::carry_out(Command command, bool read, std::span<const std::byte> d,
                                     std::vector<std::byte>& answer) {
  const auto first = [&] { return static_cast<std::uint8_t>(d[0]); };
  const auto one_byte = [&](std::uint8_t& value) -> std::uint8_t {
    if (read) {
      answer = {std::byte{value}};
      return kNone;
    }
    if (d.size() != 1) return kParameter;
    value = first();
    return kNone;
  };
  switch (command) {
    case Command::ErrorCodeOf:
      answer = {std::byte{std::exchange(last_error_, std::uint8_t{0})}};
      return kNone;
    case Command::Version:
      for (int i = 0; i < 4; ++i)
        answer.insert(answer.end(), {std::byte{0}, std::byte{0}, std::byte{0}, std::byte{major_}});
      return kNone;
    case Command::DmdType:
      answer.resize(32);
      answer[0] = std::byte{dmd_.type};
      return kNone;
    case Command::HardwareStatus:
      answer = {std::byte{hardware_}};
      return kNone;
    case Command::SystemStatus:
      answer = {std::byte{kSystemMemoryOk}};
      return kNone;
    case Command::MainStatus:
      answer = {std::byte(((parked_ || parked_stuck_) ? kMainParked : 0) | (running_ ? kMainRunning : 0))};
      return kNone;
    case Command::LedEnable: {
      std::uint8_t leds = leds_;
      const std::uint8_t refusal = one_byte(leds);
      if (!read && refusal == kNone && !led_stuck_) change_leds([&] { leds_ = leds; });
      return refusal;
    }
    case Command::LedPolarity: {
      std::uint8_t polarity = polarity_;
      const std::uint8_t refusal = one_byte(polarity);
      if (polarity > 1) return kParameter;
      if (!read && refusal == kNone) change_leds([&] { polarity_ = polarity; });
      return refusal;
    }
    case Command::LedCurrent:
      if (read) {
        answer = current_;
        return kNone;
      }
      if (d.size() != 3) return kParameter;
      if (!board_.forgets_current) change_leds([&] { current_.assign(d.begin(), d.end()); });
      return kNone;
    case Command::FlipLongAxis:
    case Command::FlipShortAxis:
      return read || (d.size() == 1 && first() <= 1) ? kNone : kParameter;
    case Command::DmdPark:
      if (running_) return kMode;
      if (d.size() != 1) return kParameter;
      parked_ = first() == 1;
      return kNone;
    case Command::DisplayMode:
      if (!read && running_) return kMode;
      if (!read && (d.size() != 1 || first() > 3)) return kParameter;
      if (!read) definition_ = configured_ = false;
      return one_byte(mode_);
    case Command::PatternStartStop:
      if (d.size() != 1 || first() > 2) return kParameter;
      if (first() == kStart) return start();
      end_run(clock_.now());
      return kNone;
    case Command::PatternDefinition:
      if (running_ || mode_ != kModeOnTheFly) return kMode;
      if (d.size() != 12 || u16(d, 0) != 0) return kDefinition;
      exposure_us_ = u16(d, 2) | static_cast<std::uint32_t>(d[4]) << 16;
      if (((static_cast<std::uint32_t>(d[5]) >> 1) & 7) != 7) return kDefinition;
      if (exposure_us_ < dmd_.shortest_exposure_us) return kExposure;
      definition_ = true;
      return kNone;
    case Command::PatternConfiguration:
      if (running_ || mode_ != kModeOnTheFly) return kMode;
      if (d.size() != 6 || u16(d, 0) != 1) return kPatterns;
      if (!definition_) return kMissing;
      if (u32(d, 2) == 0) ++endless_;
      configured_ = configured_since_image_ = true;
      return kNone;
    case Command::ImageBegin:
      return begin_image(0, d);
    case Command::ImageBlock:
      return take_block(0, d);
    case Command::SecondImageBegin:
      return dmd_.two_controllers ? begin_image(1, d) : std::uint8_t{kUnknown};
    case Command::SecondImageBlock:
      return dmd_.two_controllers ? take_block(1, d) : std::uint8_t{kUnknown};
    case Command::PowerMode:
    case Command::DmdIdle:
      return running_ ? kMode : kNone;
  }
  return kUnknown;
}

std::uint8_t Dlpc900Model::begin_image(std::size_t half, std::span<const std::byte> d) {
  if (running_ || mode_ != kModeOnTheFly) return kMode;
  if (d.size() != 6 || u16(d, 0) > 17) return kParameter;
  if (major_ >= 5 && !configured_) return kMissing;
  upload_[half].clear();
  half_[half].reset();
  expected_[half] = u32(d, 2);
  configured_since_image_ = false;
  return kNone;
}

std::uint8_t Dlpc900Model::take_block(std::size_t half, std::span<const std::byte> d) {
  if (running_ || mode_ != kModeOnTheFly) return kMode;
  if (d.size() < 2) return kParameter;
  const std::size_t n = u16(d, 0);
  if (n == 0 || n > kBlockBytes || d.size() != n + 2) return kParameter;
  if (upload_[half].size() + n > expected_[half]) return kParameter;
  upload_[half].insert(upload_[half].end(), d.begin() + 2, d.end());
  if (upload_[half].size() < expected_[half]) return kNone;
  auto mask = decode_dlpc900_image(upload_[half]);
  const PixelSize want{dmd_.size.width_px / (dmd_.two_controllers ? 2u : 1u), dmd_.size.height_px};
  if (!mask || mask->size != want) return kImage;
  half_[half] = std::move(*mask);
  return kNone;
}

std::uint8_t Dlpc900Model::start() {
  if (running_ || mode_ != kModeOnTheFly) return kMode;
  if (parked_ || parked_stuck_) return kMode;
  if (!definition_ || !configured_ || !configured_since_image_) return kMissing;
  if (!half_[0] || (dmd_.two_controllers && !half_[1])) return kImage;
  if (dmd_.two_controllers) {
    image_ = {dmd_.size, {}};
    image_.rows.reserve(std::size_t{dmd_.size.width_px} * dmd_.size.height_px);
    const std::size_t w = half_[0]->size.width_px;
    for (std::size_t y = 0; y < dmd_.size.height_px; ++y)
      for (const auto& half : half_)
        image_.rows.insert(image_.rows.end(), half->rows.begin() + static_cast<std::ptrdiff_t>(y * w),
                           half->rows.begin() + static_cast<std::ptrdiff_t>((y + 1) * w));
  } else {
    image_ = *half_[0];
  }
  running_ = true;
  run_from_ = lit_from_ = clock_.now();
  run_until_ = run_from_ + Nanoseconds{Microseconds{exposure_us_}};
  return kNone;
}

}  // namespace telefab::fab
