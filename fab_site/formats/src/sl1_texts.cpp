// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>

#include "mask_archives.hpp"

// What readers ask of the two texts. UVtools: both files must be there; layers = numFast + numSlow; numFade is the
// number of bottom layers; a layer height in either file overrides the other, so both say the same. PrusaSlicer's
// import: display_* and both layer heights from prusaslicer.ini. Odyssey: every key that PrusaSlicer writes into
// config.ini, `hollow` among them. The printers: printerModel must be theirs. The fade fits bottom layers as near as
// one can (sl1_fade.hpp).

namespace telefab::fab {
namespace {

std::string one_line(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  return text;
}

/// The tilt of the printer's two speeds; it takes the slow one where a layer lights more than area_fill % of its
/// display. Nothing for a plan without tilts.
std::string tilt_lines(const ArchiveFacts& f) {
  if (f.slow_tilt_s <= 0) return {};
  const MachineProfile& m = *f.machine;
  const double display_mm2 =
      f.size.width_px * m.projection.pixel_pitch_mm * f.size.height_px * m.projection.pixel_pitch_mm;
  const double fill = m.motion.large_area_mm2 > 0 ? 100 * m.motion.large_area_mm2 / display_mm2 : 100;
  return fmt::format("area_fill = {:.3f}\nfast_tilt_time = {}\nslow_tilt_time = {}\n", std::min(100.0, fill),
                     f.fast_tilt_s, f.slow_tilt_s);
}

/// The display as a bed: where PrusaSlicer puts what it reads back.
std::string bed_line(const ArchiveFacts& f) {
  const double pitch_mm = f.machine->projection.pixel_pitch_mm;
  return fmt::format("bed_shape = 0x0,{0:.6f}x0,{0:.6f}x{1:.6f},0x{1:.6f}\n", f.size.width_px * pitch_mm,
                     f.size.height_px * pitch_mm);
}

std::string variant_of(const MachineProfile& machine) {
  return machine.file.variant.empty() ? "default" : one_line(machine.file.variant);
}

/// Motion and waits in the words that UVtools reads, for the formats it makes of the archive. A lift or lowering in two
/// parts gives the first part under the plain word, the second under the word with a 2.
std::string notes_of(const ArchiveFacts& f) {
  std::string text;
  const auto note = [&](std::string_view word, double value) {
    text += fmt::format("{}{}_{}", text.empty() ? "" : "\\n", word, value);
  };
  const auto lift = [&](const std::string& who, const LayerMotion& m) {
    const bool is_split = m.peel_mm > 0 && m.peel_mm < m.lift_mm;
    note(who + "LiftHeight", is_split ? m.peel_mm : m.lift_mm);
    note(who + "LiftSpeed", (m.peel_mm > 0 ? m.peel_speed_mm_per_s : m.lift_speed_mm_per_s) * 60);
    if (is_split) {
      note(who + "LiftHeight2", m.lift_mm - m.peel_mm);
      note(who + "LiftSpeed2", m.lift_speed_mm_per_s * 60);
    }
    note(who + "RetractSpeed", m.lower_speed_mm_per_s * 60);
    if (m.approach_mm > 0) {
      note(who + "RetractHeight2", m.approach_mm);
      note(who + "RetractSpeed2", m.approach_speed_mm_per_s * 60);
    }
    note(who + "WaitTimeBeforeCure", m.settle_s);
    if (m.wait_after_exposure_s > 0) note(who + "WaitTimeAfterCure", m.wait_after_exposure_s);
    if (m.wait_after_lift_s > 0) note(who + "WaitTimeAfterLift", m.wait_after_lift_s);
  };
  lift("", f.motion);
  if (f.bottom_motion != f.motion) {
    lift("Bottom", f.bottom_motion);
    note("BottomLayerCount", f.bottom_layers);
  }
  if (f.transition_layers > 0) note("TransitionLayerCount", f.transition_layers);
  return text;
}

}  // namespace

std::string sl1_config(const ArchiveFacts& f, double solid_mm3) {
  const MachineProfile& m = *f.machine;
  return fmt::format(
      "action = print\n"
      "expTime = {}\n"
      "expTimeFirst = {}\n"
      "expUserProfile = 0\n"
      "fileCreationTimestamp = 1980-01-01 at 00:00:00 UTC\n"
      "hollow = 0\n"
      "jobDir = {}\n"
      "layerHeight = {}\n"
      "materialName = {}\n"
      "numFade = {}\n"
      "numFast = {}\n"
      "numSlow = {}\n"
      "printProfile = {} mm\n"
      "printTime = {:.3f}\n"
      "printerModel = {}\n"
      "printerProfile = {}\n"
      "printerVariant = {}\n"
      "prusaSlicerVersion = Telefab\n"
      "usedMaterial = {:.6f}\n",
      f.exposure_s, f.bottom_exposure_s, f.job, m.layers.thickness_mm, one_line(m.resin.name), f.fade,
      f.layers - f.slow_layers, f.slow_layers, m.layers.thickness_mm, f.print_s, f.model, m.name, variant_of(m),
      solid_mm3 / 1000);
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
             "exposure_time = {}\n"
             "faded_layers = {}\n"
             "gamma_correction = 1\n"
             "initial_exposure_time = {}\n"
             "initial_layer_height = {}\n"
             "layer_height = {}\n"
             "max_print_height = {}\n"
             "pad_enable = 0\n"
             "printer_model = {}\n"
             "printer_notes = {}\n"
             "printer_settings_id = {}\n"
             "printer_technology = SLA\n"
             "printer_variant = {}\n"
             "sla_material_settings_id = {}\n"
             "sla_print_settings_id = {} mm\n"
             "supports_enable = 0\n",
             f.size.height_px * m.projection.pixel_pitch_mm, f.optics.mirrors_x, f.optics.mirrors_y, f.size.width_px,
             f.size.height_px, f.size.width_px * m.projection.pixel_pitch_mm, f.exposure_s, f.fade, f.bottom_exposure_s,
             m.layers.thickness_mm, m.layers.thickness_mm, m.platform.z_travel_mm, f.model, notes_of(f), m.name,
             variant_of(m), one_line(m.resin.name), m.layers.thickness_mm) +
         bed_line(f) + tilt_lines(f);
}

}  // namespace telefab::fab
