// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/cure/calibration.hpp>

namespace telefab::fab {
namespace {

constexpr int kGreyStep = 17;  // 255 / 15: sixteen even levels
constexpr int kFieldColumns = 7, kFieldRows = 5;
constexpr int kPeriods[] = {2, 4, 6, 8, 12, 16};
constexpr double kStairShares[] = {0.5, 0.75, 1, 1.5, 2, 3, 4, 6};  // of a normal layer's exposure
constexpr int kStairs = 8;

class MaskDrawing {
 public:
  explicit MaskDrawing(PixelSize size)
      : mask_{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)} {}
  /// Columns x0 to x1, rows y0 to y1 from the top, the last ones left out.
  void fill(int x0, int y0, int x1, int y1, std::uint8_t grey) {
    const int width = static_cast<int>(mask_.size.width_px), height = static_cast<int>(mask_.size.height_px);
    for (int y = std::max(0, y0); y < std::min(height, y1); ++y)
      for (int x = std::max(0, x0); x < std::min(width, x1); ++x)
        mask_.rows[static_cast<std::size_t>(y) * mask_.size.width_px + static_cast<std::size_t>(x)] = grey;
  }
  [[nodiscard]] Mask take() { return std::move(mask_); }

 private:
  Mask mask_;
};

Mask field_grid(PixelSize size) {
  const int w = static_cast<int>(size.width_px), h = static_cast<int>(size.height_px), line = std::max(1, w / 400);
  MaskDrawing drawing{size};
  drawing.fill(0, 0, w, h, 255);
  for (int c = 1; c < kFieldColumns; ++c)
    drawing.fill(c * w / kFieldColumns - line, 0, c * w / kFieldColumns + line, h, 0);
  for (int r = 1; r < kFieldRows; ++r) drawing.fill(0, r * h / kFieldRows - line, w, r * h / kFieldRows + line, 0);
  return drawing.take();
}

/// A block a period: standing lines in the upper half of the frame, lying ones in the lower.
Mask line_pairs(PixelSize size) {
  const int w = static_cast<int>(size.width_px), h = static_cast<int>(size.height_px);
  const int blocks = static_cast<int>(std::size(kPeriods)), block = w / blocks;
  MaskDrawing drawing{size};
  for (int b = 0; b < blocks; ++b) {
    const int period = kPeriods[b], x0 = b * block + 2, x1 = (b + 1) * block - 2;
    for (int x = x0; x < x1; x += period) drawing.fill(x, 2, std::min(x1, x + period / 2), h / 2 - 2, 255);
    for (int y = h / 2 + 2; y < h - 2; y += period) drawing.fill(x0, y, x1, std::min(h - 2, y + period / 2), 255);
  }
  return drawing.take();
}

/// Patches `first` and up, four in a row.
Mask stairs(PixelSize size, int first) {
  const int w = static_cast<int>(size.width_px) / 4, h = static_cast<int>(size.height_px) / 2;
  MaskDrawing drawing{size};
  for (int p = first; p < kStairs; ++p) {
    const int x = (p % 4) * w, y = (p / 4) * h;
    drawing.fill(x + w / 6, y + h / 6, x + w - w / 6, y + h - h / 6, 255);
  }
  return drawing.take();
}

}  // namespace

Result<TestMasks> calibration_masks(const MachineProfile& machine) {
  const PixelSize size = machine.mask_size();
  if (size.width_px < 64 || size.height_px < 64)
    return fail(ErrorCode::InvalidInput, fmt::format("machine {} has {} x {} pixels; test masks need 64 either way",
                                                     machine.name, size.width_px, size.height_px));
  TestMasks tests;
  std::string csv = "test,grey,row,column,period_px,exposure_s,value,unit\n";
  for (int grey = 0; grey <= 255; grey += kGreyStep) {
    MaskDrawing drawing{size};
    drawing.fill(0, 0, 1 << 20, 1 << 20, static_cast<std::uint8_t>(grey));
    tests.masks.push_back({fmt::format("wedge-{:03}.png", grey), drawing.take(), 30,
                           fmt::format("whole frame at grey {}: read the radiometer in the middle of the vat", grey)});
    csv += fmt::format("wedge,{},,,,,,mW/cm2\n", grey);
  }
  tests.masks.push_back(
      {"field.png", field_grid(size), 120,
       fmt::format("{} x {} white cells: read the radiometer in the middle of each", kFieldColumns, kFieldRows)});
  for (int r = 0; r < kFieldRows; ++r)
    for (int c = 0; c < kFieldColumns; ++c) csv += fmt::format("field,,{},{},,,,mW/cm2\n", r, c);
  tests.masks.push_back({"lines.png", line_pairs(size), 120,
                         "line pairs, standing above, lying below: photograph the vat's floor, take the contrast"});
  for (const int period : kPeriods)
    for (int way = 0; way < 2; ++way) csv += fmt::format("lines,,,,{},,,contrast\n", period);
  double before = 0;
  for (int k = 0; k < kStairs; ++k) {
    const double all = machine.at_full_light().layers.exposure_s * kStairShares[k];
    tests.masks.push_back({fmt::format("stairs-{}.png", k), stairs(size, k), all - before,
                           fmt::format("patches {} to {}; patch {} has then had {:.3f} s", k, kStairs - 1, k, all)});
    csv += fmt::format("depth,,,,,{:.6g},,mm\n", all);
    before = all;
  }
  tests.measured_csv = csv;
  tests.readme = fmt::format(
      "# Calibration of {}\n\n"
      "Show the masks of exposures.json for their times, write what you measure into measured.csv (one row a reading, "
      "as\n"
      "many rows a setting as you like; delete rows you did not measure), then run\n\n"
      "    telefab-fab calibrate fit measured.csv --machine {} --out fitted.toml\n\n"
      "and put the sections of fitted.toml in the place of those in the machine's profile.\n\n"
      "| test | masks | measure | gives |\n|---|---|---|---|\n"
      "| wedge | wedge-000.png to wedge-255.png | irradiance in the middle of the frame, mW/cm2 | gamma or curve, "
      "leak, "
      "irradiance |\n"
      "| field | field.png | irradiance in the middle of each cell; row 0 is the back, column 0 the left | field |\n"
      "| lines | lines.png | contrast (most - least) / (most + least) of each block, from a linear photograph | spread "
      "|\n"
      "| depth | stairs-0.png to stairs-{}.png, one after the other | thickness of each patch cured on a glass plate, "
      "no\n"
      "  platform above it, mm | Ec, Dp |\n\n"
      "Stairs: patch k lies in column k mod 4 from the left and row k / 4 from the back. A patch that did not cure has "
      "no\n"
      "depth: delete its row. Units that are understood: mW/cm2, W/m2 and share (of white) for wedge and field, "
      "contrast\n"
      "for lines, mm and um for depth. With readings in shares give --irradiance.\n",
      machine.name, machine.name, kStairs - 1);
  return tests;
}

std::string exposures_json(const TestMasks& tests, const MachineProfile& machine) {
  using nlohmann::ordered_json;
  ordered_json exposures = ordered_json::array();
  for (const TestMask& test : tests.masks)
    exposures.push_back({{"mask", test.file}, {"exposure_s", test.seconds}, {"purpose", test.purpose}});
  const PixelSize size = machine.mask_size();
  const ordered_json value{
      {"machine", machine.name}, {"mask_px", {size.width_px, size.height_px}}, {"exposures", exposures}};
  return json_text(value, 1) + "\n";
}

}  // namespace telefab::fab
