// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/device/stage_light.hpp>

namespace telefab::fab {

/// A light engine of two devices: one shows the mask, the board of the stage switches the light behind it and times it.
/// The mask stands before the light goes on and until after it is off; the light has the exposure's time, the mask a
/// little more.
class StageLitProjector final : public Projector {
 public:
  /// Dark and black when it returns. The light must outlive it. Fails as the two devices do.
  [[nodiscard]] static Result<std::unique_ptr<StageLitProjector>> open(std::unique_ptr<Projector> picture,
                                                                       StageLight& light, Clock& clock);
  ~StageLitProjector() override;

  [[nodiscard]] const ProjectorFacts& facts() const override { return facts_; }
  /// InvalidInput also where the board cannot time the exposure or the picture not stand for so long.
  [[nodiscard]] Result<void> load(const MaskView& mask, const LightOrder& light) override;
  [[nodiscard]] Result<void> expose() override;
  [[nodiscard]] Result<ProjectorStatus> poll() override;
  [[nodiscard]] Result<void> dark() override;
  [[nodiscard]] Nanoseconds load_time(const MaskView& mask) const override { return picture_->load_time(mask); }

 private:
  StageLitProjector(std::unique_ptr<Projector> picture, StageLight& light, Clock& clock)
      : picture_{std::move(picture)}, light_{light}, clock_{clock} {}

  std::unique_ptr<Projector> picture_;
  StageLight& light_;
  Clock& clock_;
  ProjectorFacts facts_;
  LightOrder order_;
  bool exposing_ = false, exposed_ = false, light_is_over_ = false;
  ExposureReport report_;
};

}  // namespace telefab::fab
