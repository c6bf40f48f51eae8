// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/device/projector.hpp>

namespace telefab::fab {

/// Ways a virtual projector can misbehave. Counts are of calls since construction, from 0; empty: never.
struct ProjectorFaults {
  std::optional<std::uint32_t> refuse_load_at;    ///< this load answers DeviceRefused
  std::optional<std::uint32_t> lose_at_expose;    ///< this expose lights, then the device is gone until dark()
  std::optional<std::uint32_t> ignore_expose_at;  ///< this expose is accepted and never ends
  std::uint32_t refuse_dark = 0;                  ///< so many calls of dark() fail and leave the light as it is
  Nanoseconds late{};                             ///< exposures are reported over so much later than they are
};

/// A projector that lights nothing and writes down when it would have: a product, chosen by `projector = "virtual"`.
/// Strict: refuses wrong sizes, exposures while loading, and loading while lit.
class VirtualProjector final : public Projector {
 public:
  /// `bytes_per_s` 0: loading takes no time. The clock and the log must outlive the projector.
  VirtualProjector(PixelSize size, double bytes_per_s, Clock& clock, MachineLog& log);
  ~VirtualProjector() override;

  [[nodiscard]] const ProjectorFacts& facts() const override { return facts_; }
  [[nodiscard]] Result<void> load(const MaskView& mask, const LightOrder& light) override;
  [[nodiscard]] Result<void> expose() override;
  [[nodiscard]] Result<ProjectorStatus> poll() override;
  [[nodiscard]] Result<void> dark() override;
  [[nodiscard]] Nanoseconds load_time(const MaskView& mask) const override;

  ProjectorFaults faults;

 private:
  void go_dark(Nanoseconds at);

  Clock& clock_;
  MachineLog& log_;
  ProjectorFacts facts_;
  LightState state_ = LightState::Empty;
  Digest mask_;
  LightOrder light_;
  Nanoseconds ready_at_{};
  Nanoseconds lit_from_{};
  bool lit_ = false;
  bool gone_ = false;
  bool stuck_ = false;
  std::uint32_t loads_ = 0;
  std::uint32_t exposes_ = 0;
};

}  // namespace telefab::fab
