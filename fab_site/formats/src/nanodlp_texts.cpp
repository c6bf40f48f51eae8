// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>

#include "mask_archives.hpp"

// NanoDLP's manual: meta.json, plate.json, info.json and the layers from 1.png on. It reads the slicer's settings from
// options.json, UVtools the same from slicer.json. Thickness in micrometres, times in seconds, speeds in mm/min,
// boundaries in millimetres from the middle of the display, boxes in info.json in pixels, areas there in mm2. What
// TotalSolidArea of plate.json counts no document says: other writers put the volume in cm3 there, and so does this
// one.

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

double rounded(double value) { return std::round(value * 1e4) / 1e4; }
/// One reader takes whole waits only, so those that are whole are written so.
Json seconds(double value) {
  if (value == std::floor(value) && value < 1e9) return static_cast<std::uint64_t>(value);
  return value;
}
double micrometres(double mm) { return std::round(mm * 1e6) / 1e3; }

int mirror_code(Orientation optics) { return (optics.mirrors_x ? 1 : 0) + (optics.mirrors_y ? 2 : 0); }

/// Of everything lit, in millimetres from the middle of the display.
Json boundary(const ArchiveFacts& f, const std::vector<LayerSurvey>& layers) {
  const double pitch = f.machine->projection.pixel_pitch_mm;
  double left = f.size.width_px, right = 0, top = f.size.height_px, bottom = 0;
  for (const LayerSurvey& s : layers) {
    if (s.pieces == 0) continue;
    left = std::min<double>(left, s.left);
    right = std::max<double>(right, s.right);
    top = std::min<double>(top, s.top);
    bottom = std::max<double>(bottom, s.bottom);
  }
  if (right < left) left = right = f.size.width_px / 2.0, top = bottom = f.size.height_px / 2.0;
  return {{"XMin", rounded((left - f.size.width_px / 2.0) * pitch)},
          {"XMax", rounded((right - f.size.width_px / 2.0) * pitch)},
          {"YMin", rounded((top - f.size.height_px / 2.0) * pitch)},
          {"YMax", rounded((bottom - f.size.height_px / 2.0) * pitch)},
          {"ZMin", 0.0},
          {"ZMax", rounded(f.layers * f.machine->layers.thickness_mm)}};
}

}  // namespace

std::string nanodlp_meta() {
  return json_text({{"FormatVersion", 2},
                    {"Distro", "generic"},
                    {"Program", "Telefab"},
                    {"Version", "1"},
                    {"OS", "linux"},
                    {"Arch", "any"},
                    {"Profile", true}},
                   1);
}

std::string nanodlp_profile(const ArchiveFacts& f) {
  const MachineProfile& m = *f.machine;
  return json_text({{"ResinID", 0},
                    {"ProfileID", 1},
                    {"Title", f.model},
                    {"Desc", m.resin.name},
                    {"Depth", micrometres(m.layers.thickness_mm)},
                    {"SupportDepth", micrometres(m.layers.thickness_mm)},
                    {"CureTime", f.exposure_s},
                    {"SupportCureTime", f.bottom_exposure_s},
                    {"SupportLayerNumber", f.bottom_layers},
                    {"TransitionalLayer", f.transition_layers},
                    {"WaitHeight", f.motion.lift_mm},
                    {"SupportWaitHeight", f.bottom_motion.lift_mm},
                    {"WaitBeforePrint", seconds(f.motion.settle_s)},
                    {"SupportWaitBeforePrint", seconds(f.bottom_motion.settle_s)},
                    {"WaitAfterPrint", seconds(f.motion.wait_after_exposure_s)},
                    {"SupportWaitAfterPrint", seconds(f.bottom_motion.wait_after_exposure_s)},
                    {"TopWait", seconds(f.motion.wait_after_lift_s)},
                    {"SupportTopWait", seconds(f.bottom_motion.wait_after_lift_s)}},
                   1);
}

std::string nanodlp_slicer(const ArchiveFacts& f) {
  const MachineProfile& m = *f.machine;
  return json_text({{"Type", "png"},
                    {"PWidth", f.size.width_px},
                    {"PHeight", f.size.height_px},
                    {"XPixelSize", m.projection.pixel_pitch_mm},
                    {"YPixelSize", m.projection.pixel_pitch_mm},
                    {"XOffset", f.size.width_px / 2},
                    {"YOffset", f.size.height_px / 2},
                    {"StartLayer", 0},
                    {"LayerCount", f.layers},
                    {"Thickness", micrometres(m.layers.thickness_mm)},
                    {"SupportDepth", micrometres(m.layers.thickness_mm)},
                    {"SupportLayerNumber", f.bottom_layers},
                    {"FillColor", "#ffffff"},
                    {"BlankColor", "#000000"},
                    {"ImageRotate", 0},
                    {"ImageMirror", mirror_code(f.optics)},
                    {"DisplayController", 1}},
                   1);
}

std::string nanodlp_plate(const ArchiveFacts& f, const std::vector<LayerSurvey>& layers) {
  const double pixel_mm2 = f.machine->projection.pixel_pitch_mm * f.machine->projection.pixel_pitch_mm;
  const double pixel_cm3 = pixel_mm2 * f.machine->layers.thickness_mm / 1000;
  double solid_px = 0;
  for (const LayerSurvey& s : layers) solid_px += s.solid_px;
  Json plate{{"PlateID", 0},
             {"ProfileID", 1},
             {"Path", f.job},
             {"Processed", true},
             {"LayersCount", f.layers},
             {"TotalSolidArea", rounded(solid_px * pixel_cm3)},
             {"PrintTime", static_cast<std::uint64_t>(f.print_s)},
             {"PrintEst", static_cast<std::uint64_t>(f.print_s)},
             {"CreatedDate", 0},
             {"Updated", 0},
             {"ImageRotate", 0},
             {"Corrupted", false},
             {"IsFaulty", false},
             {"ReSliceNeeded", false},
             {"MultiMaterial", false}};
  plate.update(boundary(f, layers));
  return json_text(plate, 1);
}

std::string nanodlp_info(const ArchiveFacts& f, const std::vector<LayerSurvey>& layers) {
  const double pixel_mm2 = f.machine->projection.pixel_pitch_mm * f.machine->projection.pixel_pitch_mm;
  Json info = Json::array();
  for (const LayerSurvey& s : layers)
    info.push_back({{"TotalSolidArea", rounded(s.solid_px * pixel_mm2)},
                    {"LargestArea", rounded(s.largest_px * pixel_mm2)},
                    {"SmallestArea", rounded(s.smallest_px * pixel_mm2)},
                    {"MinX", s.left},
                    {"MinY", s.top},
                    {"MaxX", s.right},
                    {"MaxY", s.bottom},
                    {"AreaCount", s.pieces}});
  return json_text(info, 1);
}

}  // namespace telefab::fab
