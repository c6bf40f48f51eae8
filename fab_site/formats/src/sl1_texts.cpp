// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include "mask_archives.hpp"

// What readers ask of the two texts. UVtools: both files must be there; layers = numFast + numSlow; numFade is the
// number of bottom layers; a layer height in either file overrides the other, so both say the same. PrusaSlicer's
// import: display_* and both layer heights from prusaslicer.ini. The printer fades from expTimeFirst to expTime over
// numFade layers, where our bottom layers all have the first exposure.

namespace telefab::fab {
namespace {

std::string one_line(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  return text;
}

}  // namespace

std::string sl1_config(const ArchiveFacts& f, double solid_mm3) {
  const MachineProfile& m = *f.machine;
  return fmt::format(
      "action = print\n"
      "expTime = {:.3f}\n"
      "expTimeFirst = {:.3f}\n"
      "expUserProfile = 0\n"
      "fileCreationTimestamp = 1980-01-01 at 00:00:00 UTC\n"
      "hollow = 0\n"
      "jobDir = {}\n"
      "layerHeight = {}\n"
      "materialName = {}\n"
      "numFade = {}\n"
      "numFast = {}\n"
      "numSlow = 0\n"
      "printProfile = {} mm\n"
      "printTime = {:.3f}\n"
      "printerModel = {}\n"
      "printerProfile = {}\n"
      "printerVariant = default\n"
      "prusaSlicerVersion = Telefab\n"
      "usedMaterial = {:.6f}\n",
      f.exposure_s, f.bottom_exposure_s, f.job, m.layers.thickness_mm, one_line(m.resin.name), f.bottom_layers,
      f.layers, m.layers.thickness_mm, f.print_s, m.name, m.name, solid_mm3 / 1000);
}

std::string sl1_profile(const ArchiveFacts& f) {
  const MachineProfile& m = *f.machine;
  return fmt::format(
      "# Telefab\n"
      "absolute_correction = 0\n"
      "display_height = {:.6f}\n"
      "display_mirror_x = {:d}\n"
      "display_mirror_y = {:d}\n"
      "display_orientation = landscape\n"
      "display_pixels_x = {}\n"
      "display_pixels_y = {}\n"
      "display_width = {:.6f}\n"
      "exposure_time = {:.3f}\n"
      "faded_layers = {}\n"
      "gamma_correction = 1\n"
      "initial_exposure_time = {:.3f}\n"
      "initial_layer_height = {}\n"
      "layer_height = {}\n"
      "max_print_height = {}\n"
      "pad_enable = 0\n"
      "printer_model = {}\n"
      "printer_notes = LiftHeight_{}\\nLiftSpeed_{}\\nRetractSpeed_{}\\nWaitTimeBeforeCure_{}\n"
      "printer_settings_id = {}\n"
      "printer_technology = SLA\n"
      "printer_variant = default\n"
      "sla_material_settings_id = {}\n"
      "sla_print_settings_id = {} mm\n"
      "supports_enable = 0\n",
      f.size.height_px * m.projection.pixel_pitch_mm, f.optics.mirrors_x, f.optics.mirrors_y, f.size.width_px,
      f.size.height_px, f.size.width_px * m.projection.pixel_pitch_mm, f.exposure_s, f.bottom_layers,
      f.bottom_exposure_s, m.layers.thickness_mm, m.layers.thickness_mm, m.platform.z_travel_mm, m.name,
      m.motion.lift_mm, m.motion.lift_speed_mm_per_s * 60, m.motion.lower_speed_mm_per_s * 60, m.motion.settle_s,
      m.name, one_line(m.resin.name), m.layers.thickness_mm);
}

}  // namespace telefab::fab
