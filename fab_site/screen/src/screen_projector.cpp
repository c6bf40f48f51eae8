// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/fab/screen/screen_projector.hpp>

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

/// Packing and copying, at worst, on a slow core.
constexpr double kBytesPerSecond = 400e6;
constexpr Microseconds kShortest{20'000};
constexpr Nanoseconds kBlackWithin = 250ms;

}  // namespace

Result<std::unique_ptr<ScreenProjector>> ScreenProjector::open(std::unique_ptr<ScreenDisplay> display,
                                                               const ScreenOptions& options, Clock& clock) {
  std::unique_ptr<ScreenProjector> made{new ScreenProjector{std::move(display), options, clock}};
  if (const auto ok = made->display_->black(); !ok) return tl::unexpected{ok.error()};
  const DisplayFacts& display_facts = made->display_->facts();
  if (display_facts.words != options.layout.words || display_facts.word_bytes != bytes_per_word(options.layout.packing))
    return fail(ErrorCode::InvalidInput,
                fmt::format("screen: it shows {} x {} words of {} bytes, the profile says {} x {} of {}",
                            display_facts.words.width_px, display_facts.words.height_px, display_facts.word_bytes,
                            options.layout.words.width_px, options.layout.words.height_px,
                            bytes_per_word(options.layout.packing)));
  if (const auto fits = check_fits(options.mask, options.layout); !fits) return tl::unexpected{fits.error()};
  const auto greys = greys_of(options.layout.packing);
  const std::uint32_t fewest = *std::ranges::min_element(greys);
  made->facts_.name = fmt::format("screen {}{}{}", display_facts.name,
                                  fewest == 256 ? std::string{} : fmt::format(", {} of 256 greys", fewest),
                                  display_facts.confirms ? "" : ", unconfirmed: nothing says when a frame is shown");
  made->facts_.size = options.mask;
  made->facts_.shortest_exposure = kShortest;
  made->facts_.upload_bytes_per_s = kBytesPerSecond;
  return made;
}

ScreenProjector::~ScreenProjector() { (void)dark(); }

Nanoseconds ScreenProjector::load_time(const MaskView& mask) const {
  return Nanoseconds{static_cast<Nanoseconds::rep>(double(mask.rows.size()) / kBytesPerSecond * 1e9)};
}

Result<void> ScreenProjector::load(const MaskView& mask, const LightOrder& light) {
  if (mask.size != facts_.size || mask.rows.size() != std::size_t{mask.size.width_px} * mask.size.height_px)
    return fail(ErrorCode::InvalidInput, "the mask's size is not the projector's");
  if (light.duration < facts_.shortest_exposure)
    return fail(ErrorCode::InvalidInput, fmt::format("an exposure of {} us is below the screen's shortest, {} us",
                                                     light.duration.count(), facts_.shortest_exposure.count()));
  if (const auto step = light_step(light.share, facts_.light_steps); !step) return tl::unexpected{step.error()};
  if (state_ == LightState::Exposing) return fail(ErrorCode::Conflict, "cannot load a mask while exposing");
  const DisplayFacts& display = display_->facts();
  state_ = LightState::Empty;
  if (const auto ok = pack_mask(mask, options_.layout, display_->hidden(),
                                std::size_t{display.words.width_px} * display.word_bytes);
      !ok)
    return ok;
  duration_ = Nanoseconds{light.duration};
  state_ = LightState::Loading;
  return {};
}

Result<void> ScreenProjector::expose() {
  if (state_ != LightState::Loaded) return fail(ErrorCode::Conflict, "no mask is loaded");
  state_ = LightState::Exposing;
  if (const auto ok = display_->show(duration_); !ok) return ok;
  shown_from_ = clock_.now();
  if (options_.latency_frames > 0) clock_.sleep_for(options_.latency_frames * display_->facts().frame);
  return {};
}

Result<ProjectorStatus> ScreenProjector::poll() {
  if (state_ == LightState::Loading) {
    if (const auto ok = display_->prepare(); !ok) return tl::unexpected{ok.error()};
    state_ = LightState::Loaded;
  }
  const Nanoseconds until = shown_from_ + duration_;
  if (state_ == LightState::Exposing) {
    const auto shown = display_->is_shown();
    if (!shown) return tl::unexpected{shown.error()};
    if (!*shown) {
      if (const auto ok = display_->black(); !ok) return tl::unexpected{ok.error()};
      state_ = LightState::Exposed;
    } else if (clock_.now() > until + kBlackWithin) {
      return fail(ErrorCode::DeviceTimeout, "screen: its guard did not darken it in time");
    }
  }
  return ProjectorStatus{state_, {shown_from_, until, 0, 1}};
}

Result<void> ScreenProjector::dark() {
  state_ = LightState::Empty;
  return display_->black();
}

}  // namespace telefab::fab
