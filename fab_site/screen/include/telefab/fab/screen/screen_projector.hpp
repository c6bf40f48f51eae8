// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <telefab/fab/screen/screen_display.hpp>

namespace telefab::fab {

struct ScreenOptions {
  PixelSize mask;
  PanelLayout layout;
  /// Frames from a confirmed flip to a picture that stands: waited for in expose(), before somebody else lights it.
  /// 0 where the picture itself is the light: it comes and goes so much later.
  std::uint32_t latency_frames = 3;
};

/// A projector that is a screen: masks are packed into the hidden frame and shown for their time, which the display's
/// guard ends. It cannot be dimmed; whether there is light behind it is not its matter.
class ScreenProjector final : public Projector {
 public:
  /// Black when it returns. InvalidInput where masks do not fit the display, Device* where it is not black.
  [[nodiscard]] static Result<std::unique_ptr<ScreenProjector>> open(std::unique_ptr<ScreenDisplay> display,
                                                                     const ScreenOptions& options, Clock& clock);
  ~ScreenProjector() override;

  [[nodiscard]] const ProjectorFacts& facts() const override { return facts_; }
  [[nodiscard]] Result<void> load(const MaskView& mask, const LightOrder& light) override;
  [[nodiscard]] Result<void> expose() override;
  [[nodiscard]] Result<ProjectorStatus> poll() override;
  [[nodiscard]] Result<void> dark() override;
  [[nodiscard]] Nanoseconds load_time(const MaskView& mask) const override;

 private:
  ScreenProjector(std::unique_ptr<ScreenDisplay> display, const ScreenOptions& options, Clock& clock)
      : display_{std::move(display)}, options_{options}, clock_{clock} {}

  std::unique_ptr<ScreenDisplay> display_;
  ScreenOptions options_;
  Clock& clock_;
  ProjectorFacts facts_;
  LightState state_ = LightState::Empty;
  Nanoseconds duration_{}, shown_from_{};
};

}  // namespace telefab::fab
