// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/fab/drivers/dlpc900_image.hpp>
#include <telefab/fab/drivers/dlpc900_projector.hpp>
#include <telefab/fab/mask/orientation.hpp>
#include <utility>

namespace telefab::fab {

using namespace dlpc900;
using namespace std::chrono_literals;

namespace {

constexpr Nanoseconds kPumpTime = 40ms;
constexpr std::uint32_t kLoadTries = 3;
constexpr Nanoseconds kEarly = 3ms;  ///< an exposure over sooner than this before its time was cut short
constexpr std::uint32_t kLongestPart_us = 16'000'000;
constexpr std::uint32_t kProbeSide_px = 100;  ///< of the noise square whose upload measures the bus
constexpr double kPessimisticRate = 60e3;

std::uint8_t low_byte(std::uint32_t v) { return static_cast<std::uint8_t>(v & 0xFF); }

std::vector<std::byte> bytes(std::initializer_list<std::uint32_t> values) {
  std::vector<std::byte> out;
  for (const std::uint32_t v : values) out.push_back(std::byte{low_byte(v)});
  return out;
}

/// One entry, shown once: the controller ends the exposure itself under both readings of the count.
std::vector<std::byte> one_pattern_once() { return bytes({1, 0, 1, 0, 0, 0}); }

void append_upload(std::vector<std::vector<std::byte>>& frames, Command begin, Command block, const MaskView& part) {
  const std::vector<std::byte> image = encode_dlpc900_image(part);
  const auto size = static_cast<std::uint32_t>(image.size());
  frames.push_back(frame(kWrite, 0, begin, bytes({0, 0, size, size >> 8, size >> 16, size >> 24})));
  for (std::size_t at = 0; at < image.size(); at += kBlockBytes) {
    const std::size_t n = std::min(kBlockBytes, image.size() - at);
    std::vector<std::byte> data = bytes({static_cast<std::uint32_t>(n), static_cast<std::uint32_t>(n >> 8)});
    data.insert(data.end(), image.begin() + static_cast<std::ptrdiff_t>(at),
                image.begin() + static_cast<std::ptrdiff_t>(at + n));
    frames.push_back(frame(kWrite, 0, block, data));
  }
}

std::size_t total_bytes(const std::vector<std::vector<std::byte>>& frames) {
  std::size_t n = 0;
  for (const auto& f : frames) n += f.size();
  return n;
}

}  // namespace

Mask place_on_mirrors(const MaskView& mask, PixelSize mirrors, OpticsTurn orientation) {
  const Mask turned = turned_for_optics(mask, orientation_of(orientation));
  Mask out{mirrors, std::vector<std::uint8_t>(std::size_t{mirrors.width_px} * mirrors.height_px)};
  const std::uint32_t left = (mirrors.width_px - mask.size.width_px) / 2;
  const std::uint32_t top = (mirrors.height_px - mask.size.height_px) / 2;
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y)
    std::copy_n(turned.rows.data() + std::size_t{y} * mask.size.width_px, mask.size.width_px,
                out.rows.data() + std::size_t{top + y} * mirrors.width_px + left);
  return out;
}

Result<std::unique_ptr<Dlpc900Projector>> Dlpc900Projector::open(std::unique_ptr<UsbTransport> usb,
                                                                 const Dlpc900Options& options, Clock& clock) {
  std::unique_ptr<Dlpc900Projector> made{new Dlpc900Projector{std::move(usb), options, clock}};
  if (const auto ok = made->leds_off(); !ok)
    if (const auto again = made->rescue(); !again) return tl::unexpected{again.error()};
  if (const auto ok = made->identify(); !ok) return tl::unexpected{ok.error()};
  if (const auto ok = made->prepare(); !ok) return tl::unexpected{ok.error()};
  if (const auto ok = made->measure_rate(); !ok) return tl::unexpected{ok.error()};
  return made;
}

Dlpc900Projector::~Dlpc900Projector() { (void)dark(); }

Result<void> Dlpc900Projector::leds_off() {
  // The LEDs first: it is the one command that darkens whatever the sequencer does.
  const auto off = link_.set_byte(Command::LedEnable, kLedsOff);
  const auto zero = options_.off_needs_zero_current ? set_current(0) : Result<void>{};
  const auto stop = link_.set_byte(Command::PatternStartStop, kStop);
  if (!off) return off;
  if (!zero) return zero;
  if (!stop) return stop;
  const auto leds = link_.query_byte(Command::LedEnable);
  if (!leds) return tl::unexpected{leds.error()};
  const auto status = link_.query_byte(Command::MainStatus);
  if (!status) return tl::unexpected{status.error()};
  if (*leds != kLedsOff)
    return fail(ErrorCode::DeviceRefused, "projector: the LEDs stay enabled after being switched off");
  if ((*status & kMainRunning) != 0)
    return fail(ErrorCode::DeviceRefused, "projector: the sequence goes on after being stopped");
  return {};
}

Result<void> Dlpc900Projector::set_current(std::uint8_t current) {
  current_.reset();
  // Polarity first: without it a current of zero is full light on some boards.
  if (const auto ok = link_.set_byte(Command::LedPolarity, options_.inverted_led_polarity ? 1 : 0); !ok) return ok;
  const auto wanted = bytes({options_.led == Led::Red ? current : 0u, options_.led == Led::Green ? current : 0u,
                             options_.led == Led::Blue ? current : 0u});
  if (const auto ok = link_.set(Command::LedCurrent, wanted); !ok) return ok;
  const auto polarity = link_.query_byte(Command::LedPolarity);
  if (!polarity) return tl::unexpected{polarity.error()};
  const auto now = link_.query(Command::LedCurrent, 3);
  if (!now) return tl::unexpected{now.error()};
  if (*polarity != (options_.inverted_led_polarity ? 1 : 0) || !std::equal(wanted.begin(), wanted.end(), now->begin()))
    return fail(ErrorCode::DeviceRefused, "projector: it keeps another LED current or polarity than it was told");
  current_ = current;
  return {};
}

Result<void> Dlpc900Projector::identify() {
  const auto version = link_.query(Command::Version, 16);
  if (!version) return tl::unexpected{version.error()};
  const auto type = link_.query(Command::DmdType, 1);
  if (!type) return tl::unexpected{type.error()};
  const auto at = [&](std::size_t i) { return static_cast<std::uint8_t>((*version)[i]); };
  identity_.patch = static_cast<std::uint16_t>(at(0) | at(1) << 8);
  identity_.minor = at(2);
  identity_.major = at(3);
  const auto code = static_cast<std::uint8_t>((*type)[0]);
  const auto dmd = dmd_facts(code);
  if (!dmd) return fail(ErrorCode::DeviceRefused, fmt::format("projector: mirror array of unknown type {}", code));
  identity_.dmd = *dmd;
  if (options_.mask.width_px > dmd->size.width_px || options_.mask.height_px > dmd->size.height_px)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the machine's masks have {} x {} pixels, the {} has {} x {} mirrors", options_.mask.width_px,
                    options_.mask.height_px, dmd->name, dmd->size.width_px, dmd->size.height_px));
  const MirrorControllers stated = options_.controllers;
  if (stated != MirrorControllers::Auto && (stated == MirrorControllers::One) == dmd->two_controllers)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the profile says projection.controllers = \"{}\"; {} controller drives the {}. Correct it",
                            name_of(stated), dmd->two_controllers ? "more than one" : "one", dmd->name));
  facts_.name =
      fmt::format("DLPC900 {} firmware {}.{}.{}", dmd->name, identity_.major, identity_.minor, identity_.patch);
  facts_.size = options_.mask;
  facts_.shortest_exposure = Microseconds{dmd->shortest_exposure_us};
  facts_.longest_undivided = Microseconds{kLongestPart_us};
  facts_.upload_bytes_per_s = kPessimisticRate;
  // Its LED current is a duty cycle of 8 bits; light in proportion to it is assumed, and calibrated per share.
  facts_.light_steps = std::max<std::uint32_t>(1, options_.led_current);
  return {};
}

Result<void> Dlpc900Projector::check_status() {
  const auto hardware = link_.query_byte(Command::HardwareStatus);
  if (!hardware) return tl::unexpected{hardware.error()};
  const auto system = link_.query_byte(Command::SystemStatus);
  if (!system) return tl::unexpected{system.error()};
  const auto main = link_.query_byte(Command::MainStatus);
  if (!main) return tl::unexpected{main.error()};
  identity_.hardware_status = *hardware;
  identity_.system_status = *system;
  identity_.main_status = *main;
  const auto refuse = [](std::string_view what) {
    return fail(ErrorCode::DeviceRefused, fmt::format("projector self-test: {}", what));
  };
  if ((*hardware & kHardwareInitOk) == 0) return refuse("its controller did not start up");
  if ((*hardware & kHardwareWrongDmd) != 0) return refuse("wrong mirror array for its firmware");
  if ((*hardware & kHardwareResetError) != 0) return refuse("mirror reset controller error");
  if ((*hardware & kHardwareSequencerAbort) != 0) return refuse("the sequencer aborted");
  if ((*hardware & kHardwareSequencerError) != 0) return refuse("the sequencer reports an error");
  if (identity_.dmd.two_controllers && (*hardware & kHardwareSecondReady) == 0)
    return refuse("its second controller is not ready");
  if ((*system & kSystemMemoryOk) == 0) return refuse("its memory test failed");
  if ((*main & kMainParked) != 0) return refuse("its mirrors are parked");
  return {};
}

Result<void> Dlpc900Projector::prepare() {
  const FirmwareFacts& firmware = firmware_facts(identity_.major, identity_.minor);
  if (const auto ok = leds_off(); !ok) return ok;
  const auto mode = link_.query_byte(Command::DisplayMode);
  if (!mode) return tl::unexpected{mode.error()};
  if (*mode != kModeOnTheFly) {
    if (const auto ok = link_.set_byte(Command::DisplayMode, kModeOnTheFly); !ok) return ok;
    if (firmware.park_after_mode_change)
      for (const std::uint8_t parked : {std::uint8_t{1}, std::uint8_t{0}})
        if (const auto ok = link_.set_byte(Command::DmdPark, parked); !ok) return ok;
    if (const auto ok = link_.set_byte(Command::PatternStartStop, kStop); !ok) return ok;
  }
  for (const Command flip : {Command::FlipLongAxis, Command::FlipShortAxis})
    if (const auto ok = link_.set_byte(flip, 0); !ok) return ok;  // the mask itself is turned
  if (const auto ok = set_current(options_.off_needs_zero_current ? std::uint8_t{0} : options_.led_current); !ok)
    return ok;
  if (const auto ok = check_status(); !ok) return ok;
  return leds_off();
}

std::vector<std::vector<std::byte>> Dlpc900Projector::frames_of(const Mask& mirrors, std::uint32_t exposure_us) const {
  std::vector<std::vector<std::byte>> frames;
  frames.push_back(frame(kWrite, 0, Command::PatternStartStop, bytes({kStop})));
  frames.push_back(frame(kWrite, 0, Command::PatternDefinition, pattern_definition(exposure_us, options_.led)));
  frames.push_back(frame(kWrite, 0, Command::PatternConfiguration, one_pattern_once()));
  if (identity_.dmd.two_controllers) {
    const std::array<Mask, 2> halves = halves_of(mirrors.view());
    const std::size_t first = options_.controllers == MirrorControllers::RightLeft ? 1 : 0;
    append_upload(frames, Command::ImageBegin, Command::ImageBlock, halves[first].view());
    append_upload(frames, Command::SecondImageBegin, Command::SecondImageBlock, halves[1 - first].view());
  } else {
    append_upload(frames, Command::ImageBegin, Command::ImageBlock, mirrors.view());
  }
  return frames;
}

Result<void> Dlpc900Projector::measure_rate() {
  // Noise does not compress: some 30 kB, sent dark and never shown.
  Mask noise{{kProbeSide_px, kProbeSide_px}, std::vector<std::uint8_t>(kProbeSide_px * kProbeSide_px)};
  std::uint32_t x = 1;
  for (auto& p : noise.rows) p = low_byte((x = x * 1664525u + 1013904223u) >> 24);
  frames_ = frames_of(place_on_mirrors(noise.view(), identity_.dmd.size, OpticsTurn::Normal),
                      identity_.dmd.shortest_exposure_us);
  sent_ = restarts_ = 0;
  state_ = LightState::Loading;
  const std::size_t total = total_bytes(frames_);
  const Nanoseconds from = clock_.now();
  while (state_ == LightState::Loading)
    if (const auto ok = pump(); !ok) return ok;
  const double took_s = double((clock_.now() - from).count()) * 1e-9;
  if (took_s > 0) facts_.upload_bytes_per_s = double(total) / took_s;
  return dark();
}

Nanoseconds Dlpc900Projector::load_time(const MaskView& mask) const {
  const Mask mirrors = place_on_mirrors(mask, identity_.dmd.size, options_.orientation);
  const double s =
      double(total_bytes(frames_of(mirrors, identity_.dmd.shortest_exposure_us))) / facts_.upload_bytes_per_s;
  return Nanoseconds{static_cast<Nanoseconds::rep>(s * 1e9)};
}

Result<void> Dlpc900Projector::load(const MaskView& mask, const LightOrder& light) {
  const Microseconds exposure = light.duration;
  if (mask.size != facts_.size || mask.rows.size() != std::size_t{mask.size.width_px} * mask.size.height_px)
    return fail(ErrorCode::InvalidInput, "the mask's size is not the projector's");
  if (exposure < facts_.shortest_exposure)
    return fail(ErrorCode::InvalidInput, fmt::format("an exposure of {} us is below the projector's shortest, {} us",
                                                     exposure.count(), facts_.shortest_exposure.count()));
  if (state_ == LightState::Exposing) return fail(ErrorCode::Conflict, "cannot load a mask while exposing");
  const auto step = light_step(light.share, facts_.light_steps);
  if (!step) return tl::unexpected{step.error()};
  wanted_current_ = light.share == 1 ? options_.led_current : static_cast<std::uint8_t>(*step);
  parts_ = static_cast<std::uint32_t>((exposure.count() + kLongestPart_us - 1) / kLongestPart_us);
  part_us_ = static_cast<std::uint32_t>((exposure.count() + parts_ / 2) / parts_);
  frames_ = frames_of(place_on_mirrors(mask, identity_.dmd.size, options_.orientation), part_us_);
  sent_ = restarts_ = 0;
  report_ = {};
  (void)link_.take_retries();
  state_ = LightState::Loading;
  return {};
}

Result<void> Dlpc900Projector::pump() {
  const Nanoseconds until = clock_.now() + kPumpTime;
  const auto send_some = [&]() -> Result<void> {
    while (sent_ < frames_.size()) {
      if (const auto ok = link_.send(frames_[sent_]); !ok) return ok;
      ++sent_;
      if (clock_.now() >= until) return {};
    }
    const auto error = link_.query_byte(Command::ErrorCodeOf);
    if (!error) return tl::unexpected{error.error()};
    if (*error != 0)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("projector: the mask was refused with error {} ({})", *error, error_text(*error)));
    // Again behind the images: right for every firmware.
    if (const auto ok = link_.set(Command::PatternConfiguration, one_pattern_once()); !ok) return ok;
    state_ = LightState::Loaded;
    frames_.clear();
    return {};
  };
  const auto sent = send_some();
  if (sent) return {};
  if (++restarts_ >= kLoadTries) return sent;
  // Nothing was lit: the whole mask once more, on a new connection if the old one is gone.
  if (sent.error().code == ErrorCode::DeviceLost) {
    if (const auto ok = rescue(); !ok) return ok;
  } else {
    if (const auto ok = link_.clear_halts(); !ok) return ok;
  }
  sent_ = 0;
  state_ = LightState::Loading;
  ++report_.retries;
  return {};
}

Result<void> Dlpc900Projector::start_part() {
  const std::byte start[] = {std::byte{kStart}};
  const Nanoseconds before = clock_.now();
  const auto patience =
      std::clamp<Milliseconds>(std::chrono::duration_cast<Milliseconds>(Microseconds{part_us_ / 4}), 20ms, 1000ms);
  const auto started = link_.set_once(Command::PatternStartStop, start, patience);
  part_from_ = clock_.now();
  if (started) return {};
  // The command or its answer was lost: ask before anything is repeated.
  (void)link_.clear_halts();
  const auto status = link_.query_byte(Command::MainStatus);
  if (!status) return tl::unexpected{status.error()};
  if ((*status & kMainRunning) != 0) {
    part_from_ = before;
    ++report_.retries;
    return {};
  }
  if (clock_.now() - before < Nanoseconds{Microseconds{part_us_}} / 2 && report_.parts == 1)
    return fail(ErrorCode::DeviceRefused, "projector: the exposure did not start: " + started.error().what);
  return fail(ErrorCode::DeviceTimeout, "projector: no telling whether the exposure was made: " + started.error().what);
}

Result<void> Dlpc900Projector::expose() {
  if (state_ != LightState::Loaded) return fail(ErrorCode::Conflict, "no mask is loaded");
  const auto surely_dark = [](const Error& e) {
    return fail(ErrorCode::DeviceRefused, "before the light went on: " + e.what);
  };
  if (const auto ok = check_status(); !ok) return surely_dark(ok.error());
  const auto mode = link_.query_byte(Command::DisplayMode);
  if (!mode) return surely_dark(mode.error());
  if (*mode != kModeOnTheFly)
    return fail(ErrorCode::DeviceRefused, "projector: it left the pattern mode; it was reset");
  if (current_ != wanted_current_)
    if (const auto ok = set_current(wanted_current_); !ok) return surely_dark(ok.error());
  if (const auto ok = link_.set_byte(Command::LedEnable, kLedsBySequencer); !ok) return surely_dark(ok.error());
  const auto leds = link_.query_byte(Command::LedEnable);
  if (!leds) return surely_dark(leds.error());
  if (*leds != kLedsBySequencer) return fail(ErrorCode::DeviceRefused, "projector: the LEDs cannot be enabled");
  report_.lit_from = clock_.now();
  report_.parts = 1;
  lit_for_ = {};
  if (const auto ok = start_part(); !ok) return ok;
  parts_left_ = parts_ - 1;
  state_ = LightState::Exposing;
  return {};
}

Result<bool> Dlpc900Projector::part_is_over() {
  const Nanoseconds length = Microseconds{part_us_};
  if (clock_.now() < part_from_ + length - kEarly) return false;
  const auto status = link_.query_byte(Command::MainStatus);
  if (!status) return tl::unexpected{status.error()};
  const Nanoseconds now = clock_.now();
  if ((*status & kMainRunning) != 0) return false;
  const auto mode = link_.query_byte(Command::DisplayMode);
  if (!mode) return tl::unexpected{mode.error()};
  if (*mode != kModeOnTheFly) return fail(ErrorCode::DeviceRefused, "projector: it was reset during the exposure");
  if (const auto ok = check_status(); !ok) return fail_in("after the exposure", ok.error());
  if (now - part_from_ < length - kEarly)
    return fail(ErrorCode::DeviceRefused, "projector: the exposure ended too early");
  lit_for_ += std::min(now - part_from_, length);
  return true;
}

Result<ProjectorStatus> Dlpc900Projector::poll() {
  if (state_ == LightState::Loading)
    if (const auto ok = pump(); !ok) return tl::unexpected{ok.error()};
  if (state_ == LightState::Exposing) {
    const auto over = part_is_over();
    if (!over) return tl::unexpected{over.error()};
    if (*over && parts_left_ > 0) {
      --parts_left_;
      ++report_.parts;
      if (const auto ok = start_part(); !ok) return tl::unexpected{ok.error()};
    } else if (*over) {
      if (const auto ok = leds_off(); !ok) return tl::unexpected{ok.error()};
      report_.lit_until = report_.lit_from + lit_for_;
      report_.retries += link_.take_retries();
      state_ = LightState::Exposed;
    }
  }
  return ProjectorStatus{state_, report_};
}

Result<void> Dlpc900Projector::rescue() {
  if (const auto ok = link_.reopen(); !ok) return ok;
  if (const auto ok = leds_off(); !ok) return ok;
  const Dlpc900Identity before = identity_;
  if (before.dmd.type == 0) return {};  // still opening
  if (const auto ok = identify(); !ok) return ok;
  if (identity_.dmd.type != before.dmd.type)
    return fail(ErrorCode::DeviceRefused, "projector: another mirror array came back");
  return prepare();
}

Result<void> Dlpc900Projector::dark() {
  state_ = LightState::Empty;
  frames_.clear();
  if (leds_off()) {
    const auto mode = link_.query_byte(Command::DisplayMode);
    if (mode && *mode == kModeOnTheFly) return {};
    // Reset behind our back: dark, but no longer set up.
    if (mode) return prepare();
  }
  return rescue();
}

}  // namespace telefab::fab
