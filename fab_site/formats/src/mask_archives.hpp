// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/mask/orientation.hpp>
#include <telefab/fab/print/print_plan.hpp>

#include "mask_survey.hpp"

namespace telefab::fab {

/// All that the texts inside an archive tell of a job.
struct ArchiveFacts {
  std::string job;  ///< letters, digits, '-', '_' and '.' only
  PixelSize size;
  Orientation optics;
  const MachineProfile* machine = nullptr;
  std::string model;  ///< of the printer, as its firmware compares it
  std::uint32_t layers = 0;
  std::uint32_t bottom_layers = 0;
  double exposure_s = 0;
  double bottom_exposure_s = 0;
  std::uint32_t fade = 0;               ///< sl1: numFade
  std::uint32_t transition_layers = 0;  ///< behind the bottom ones, their exposures falling in even steps
  LayerMotion motion;                   ///< of most layers behind the bottom ones
  LayerMotion bottom_motion;
  double fast_tilt_s = 0;         ///< shortest tilt of a layer
  double slow_tilt_s = 0;         ///< longest
  std::uint32_t slow_layers = 0;  ///< that tilt longer than the fastest
  double print_s = 0;
};

/// What an archive tells of a plan, and in `report` what it cannot. Fails as export_masks does before the first mask.
[[nodiscard]] Result<ArchiveFacts> archive_facts(MaskFormat format, const PrintPlan& plan,
                                                 const MachineProfile& machine, const std::filesystem::path& path,
                                                 MaskExportReport& report);

/// Texts of an SL1 archive. `solid_mm3`: grey-weighted volume of all masks.
[[nodiscard]] std::string sl1_config(const ArchiveFacts& facts, double solid_mm3);
[[nodiscard]] std::string sl1_profile(const ArchiveFacts& facts);

/// Texts of a NanoDLP archive.
[[nodiscard]] std::string nanodlp_meta();
[[nodiscard]] std::string nanodlp_profile(const ArchiveFacts& facts);
[[nodiscard]] std::string nanodlp_slicer(const ArchiveFacts& facts);
[[nodiscard]] std::string nanodlp_plate(const ArchiveFacts& facts, const std::vector<LayerSurvey>& layers);
[[nodiscard]] std::string nanodlp_info(const ArchiveFacts& facts, const std::vector<LayerSurvey>& layers);

}  // namespace telefab::fab
