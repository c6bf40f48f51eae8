// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/device/virtual_projector.hpp>

namespace telefab::fab {

namespace {

constexpr std::uint32_t kLightSteps = 255;

}  // namespace

Result<std::uint32_t> light_step(double share, std::uint32_t light_steps) {
  constexpr double kNear = 0.01;
  if (!(share > 0 && share <= 1))
    return fail(ErrorCode::InvalidInput, fmt::format("a share of the light of {} is not above 0 and up to 1", share));
  const double step = std::round(share * light_steps), comes_out = step / light_steps;
  if (std::abs(comes_out - share) <= kNear * share) return static_cast<std::uint32_t>(step);
  if (light_steps <= 1)
    return fail(ErrorCode::InvalidInput,
                fmt::format("this light engine cannot be dimmed to {}; state layers.light_share = 1 and a shorter "
                            "exposure",
                            share));
  return fail(ErrorCode::InvalidInput,
              fmt::format("of {} steps of light none is within 1 % of a share of {}; state layers.light_share = {:.4f}",
                          light_steps, share, std::max(step, 1.0) / light_steps));
}

VirtualProjector::VirtualProjector(PixelSize size, double bytes_per_s, Clock& clock, MachineLog& log)
    : clock_{clock}, log_{log}, facts_{"virtual projector", size, Microseconds{1000}, bytes_per_s, kLightSteps} {}

VirtualProjector::~VirtualProjector() { go_dark(clock_.now()); }

Nanoseconds VirtualProjector::load_time(const MaskView& mask) const {
  if (facts_.upload_bytes_per_s <= 0) return {};
  return Nanoseconds{static_cast<Nanoseconds::rep>(double(mask.rows.size()) / facts_.upload_bytes_per_s * 1e9)};
}

Result<void> VirtualProjector::load(const MaskView& mask, const LightOrder& light) {
  if (mask.size != facts_.size || mask.rows.size() != std::size_t{mask.size.width_px} * mask.size.height_px)
    return fail(ErrorCode::InvalidInput, "the mask's size is not the projector's");
  if (const auto step = light_step(light.share, facts_.light_steps); !step) return tl::unexpected{step.error()};
  if (light.duration < facts_.shortest_exposure) return fail(ErrorCode::InvalidInput, "the exposure is too short");
  if (state_ == LightState::Exposing) return fail(ErrorCode::Conflict, "cannot load a mask while exposing");
  if (faults.refuse_load_at == loads_++) return fail(ErrorCode::DeviceRefused, "virtual projector: load refused");
  mask_ = digest_of(std::as_bytes(mask.rows));
  light_ = light;
  ready_at_ = clock_.now() + load_time(mask);
  state_ = LightState::Loading;
  return {};
}

Result<void> VirtualProjector::expose() {
  if (state_ == LightState::Loading && clock_.now() >= ready_at_) state_ = LightState::Loaded;
  if (state_ != LightState::Loaded) return fail(ErrorCode::Conflict, "no mask is loaded");
  const std::uint32_t call = exposes_++;
  lit_from_ = clock_.now();
  state_ = LightState::Exposing;
  stuck_ = faults.ignore_expose_at == call;
  lit_ = !stuck_;
  gone_ = faults.lose_at_expose == call;
  return {};
}

Result<ProjectorStatus> VirtualProjector::poll() {
  if (gone_) return fail(ErrorCode::DeviceLost, "virtual projector: gone");
  const Nanoseconds now = clock_.now();
  if (state_ == LightState::Loading && now >= ready_at_) state_ = LightState::Loaded;
  const Nanoseconds end = lit_from_ + light_.duration;
  if (state_ == LightState::Exposing && !stuck_ && now >= end + faults.late) {
    go_dark(now);
    state_ = LightState::Exposed;
  }
  return ProjectorStatus{state_, {lit_from_, end, 0, 1}};
}

Result<void> VirtualProjector::dark() {
  if (faults.refuse_dark > 0) {
    --faults.refuse_dark;
    return fail(ErrorCode::DeviceTimeout, "virtual projector: no answer to dark");
  }
  go_dark(clock_.now());
  gone_ = stuck_ = false;
  state_ = LightState::Empty;
  return {};
}

void VirtualProjector::go_dark(Nanoseconds at) {
  if (!lit_) return;
  lit_ = false;
  log_.lit({lit_from_, std::min(at, lit_from_ + Nanoseconds{light_.duration}), mask_, log_.z_mm(), light_.share});
}

}  // namespace telefab::fab
