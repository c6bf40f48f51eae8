// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/fab/drivers/stage_lit_projector.hpp>

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

/// The mask stands so much longer than the light: for the way of the order, and for boards whose clock is a resonator.
Microseconds mask_time(const LightOrder& light, Nanoseconds lead) {
  constexpr Microseconds kSpare = 250ms;
  constexpr int kClockParts = 100;
  return std::chrono::ceil<Microseconds>(lead) + light.duration + light.duration / kClockParts + kSpare;
}

}  // namespace

Result<std::unique_ptr<StageLitProjector>> StageLitProjector::open(std::unique_ptr<Projector> picture,
                                                                   StageLight& light, Clock& clock) {
  std::unique_ptr<StageLitProjector> made{new StageLitProjector{std::move(picture), light, clock}};
  if (const auto ok = made->dark(); !ok) return tl::unexpected{ok.error()};
  const ProjectorFacts& shown = made->picture_->facts();
  const StageLightFacts& lit = light.light_facts();
  made->facts_ = shown;
  made->facts_.name = shown.name + "; " + lit.name;
  made->facts_.shortest_exposure = lit.shortest_exposure;
  made->facts_.exposure_step = lit.exposure_step;
  made->facts_.light_steps = lit.light_steps;
  return made;
}

StageLitProjector::~StageLitProjector() { (void)dark(); }

Result<void> StageLitProjector::load(const MaskView& mask, const LightOrder& light) {
  if (exposing_) return fail(ErrorCode::Conflict, "cannot load a mask while exposing");
  if (const auto ok = light_.check_light(light); !ok) return ok;
  const Microseconds stands = mask_time(light, light_.light_facts().lead);
  if (const Microseconds most = picture_->facts().longest_undivided; most > 0us && stands > most)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("{} shows a mask for {} ms at most, the light of {} ms needs it for {}; more light and "
                    "shorter exposures are the way out",
                    picture_->facts().name, most.count() / 1000, light.duration.count() / 1000, stands.count() / 1000));
  exposed_ = false;
  order_ = light;
  return picture_->load(mask, {stands, 1});
}

Result<void> StageLitProjector::expose() {
  if (exposing_ || exposed_) return fail(ErrorCode::Conflict, "no mask is loaded");
  // Whatever the picture does, there is no light yet.
  if (const auto shown = picture_->expose(); !shown) {
    if (shown.error().code == ErrorCode::Conflict) return shown;
    (void)picture_->dark();
    return fail(ErrorCode::DeviceRefused, "before the light went on: " + shown.error().what);
  }
  if (const auto lit = light_.light(order_); !lit) {
    (void)picture_->dark();
    return lit;
  }
  exposing_ = true;
  light_is_over_ = false;
  report_ = {};
  return {};
}

Result<ProjectorStatus> StageLitProjector::poll() {
  if (exposed_) return ProjectorStatus{LightState::Exposed, report_};
  const auto picture = picture_->poll();
  if (!exposing_) return picture;
  if (!light_is_over_) {
    const auto light = light_.poll_light();
    if (!light) return tl::unexpected{light.error()};
    light_is_over_ = light->is_over;
    report_.lit_from = light->lit_from;
    report_.lit_until = light->lit_until;
  }
  if (!picture) return picture;
  const bool mask_is_over = picture->state != LightState::Exposing;
  if (mask_is_over && !light_is_over_)
    return fail(ErrorCode::DeviceTimeout, "the mask was gone before its light was over");
  if (mask_is_over) {
    report_.retries = picture->report.retries;
    exposing_ = false;
    exposed_ = true;
    return ProjectorStatus{LightState::Exposed, report_};
  }
  return ProjectorStatus{LightState::Exposing, report_};
}

Result<void> StageLitProjector::dark() {
  exposing_ = exposed_ = light_is_over_ = false;
  // The light first; the picture whatever became of it.
  const auto unlit = light_.unlight();
  const auto black = picture_->dark();
  if (!unlit) return unlit;
  return black;
}

}  // namespace telefab::fab
