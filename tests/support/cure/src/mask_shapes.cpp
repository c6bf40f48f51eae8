// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <functional>
#include <numbers>
#include <telefab/fab/verify/layer_runs.hpp>
#include <telefab/test/mask_shapes.hpp>

namespace telefab::test {
namespace {

constexpr double kPitch = 0.05;
constexpr double kMiddle = 48;  // px; the mask is 96 wide
constexpr double kTurn = 2 * std::numbers::pi;

/// Pixels about the mask's middle, turned, shifted, in millimetres.
Contour ring(const std::vector<fab::PixelPlace>& places, double turn_rad, fab::PixelPlace shift) {
  std::vector<Point2> vertices;
  for (const auto& p : places)
    vertices.push_back({kPitch * (kMiddle + shift.x_px + p.x_px * std::cos(turn_rad) - p.y_px * std::sin(turn_rad)),
                        kPitch * (kMiddle + shift.y_px + p.x_px * std::sin(turn_rad) + p.y_px * std::cos(turn_rad))});
  return Contour::from_vertices(std::move(vertices)).value();
}

std::vector<fab::PixelPlace> polar(int count, const std::function<double(int)>& radius) {
  std::vector<fab::PixelPlace> places;
  for (int i = 0; i < count; ++i)
    places.push_back({radius(i) * std::cos(kTurn * i / count), radius(i) * std::sin(kTurn * i / count)});
  return places;
}

std::vector<fab::PixelPlace> box(double x0, double y0, double x1, double y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

/// The letter E of strokes of a width, as one ring.
std::vector<fab::PixelPlace> letter_e(double stroke) {
  const double h = 8 * stroke / 2, w = 5 * stroke;
  const double m = stroke / 2;
  return {{0, -h},      {w, -h},     {w, -h + stroke},     {stroke, -h + stroke}, {stroke, -m}, {0.8 * w, -m},
          {0.8 * w, m}, {stroke, m}, {stroke, h - stroke}, {w, h - stroke},       {w, h},       {0, h}};
}

struct Family {
  std::string name;
  double turn_rad;
  std::vector<std::vector<fab::PixelPlace>> rings;
};

std::vector<Family> families() {
  std::vector<Family> all;
  for (const double radius : {3.0, 5.0, 8.0, 15.0, 30.0})
    all.push_back({"circle " + std::to_string(static_cast<int>(radius)),
                   0,
                   {polar(40 + static_cast<int>(8 * radius), [=](int) { return radius; })}});
  for (const int degrees : {0, 7, 22, 45})
    all.push_back({"square " + std::to_string(degrees), degrees * kTurn / 360, {box(-12, -12, 12, 12)}});
  // Teeth with straight flanks, and a bore.
  std::vector<fab::PixelPlace> gear;
  for (int tooth = 0; tooth < 12; ++tooth)
    for (const auto& [share, radius] : {std::pair{0.0, 20.0}, {0.3, 20.0}, {0.4, 26.0}, {0.9, 26.0}}) {
      const double angle = kTurn * (tooth + share) / 12;
      gear.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
  auto bore = polar(96, [](int) { return 8.0; });
  std::reverse(bore.begin(), bore.end());
  all.push_back({"gear", 0.05, {gear, bore}});
  all.push_back({"star", 0.1, {polar(14, [](int i) { return i % 2 ? 10.0 : 24.0; })}});
  for (const double stroke : {2.0, 3.0})
    all.push_back({"strokes " + std::to_string(static_cast<int>(stroke)), 0.15, {letter_e(stroke)}});
  return all;
}

constexpr fab::PixelPlace kOffsets[] = {{0, 0}, {0.37, 0.21}, {0.5, 0.5}};

}  // namespace

MachineProfile judge_machine(double spread_px) {
  MachineProfile m;
  m.name = "judge";
  m.platform = {96 * kPitch, 96 * kPitch, 50};
  m.projection.pixel_pitch_mm = kPitch;
  m.projection.spread_px = spread_px;
  m.projection.irradiance_mw_per_cm2 = 10;
  m.layers = {0.05, 2.0, 0, 2.0};
  m.resin = {"judge", 10, 0.1};
  return m;
}

std::vector<MaskShape> mask_shapes() {
  std::vector<MaskShape> shapes;
  for (const Family& family : families())
    for (const auto& offset : kOffsets) {
      MaskShape shape{family.name, {}};
      for (const auto& places : family.rings) shape.rings.push_back(ring(places, family.turn_rad, offset));
      shapes.push_back(std::move(shape));
    }
  return shapes;
}

std::vector<ThinFeature> thin_features(double width_px, bool gaps) {
  std::vector<ThinFeature> features;
  for (const double degrees : {0.0, 10.0, 22.5, 35.0, 45.0})
    for (int eighth = 0; eighth < 8; ++eighth) {
      const double turn = degrees * kTurn / 360, shift = eighth / 8.0, half = width_px / 2;
      ThinFeature feature;
      feature.gap = gaps;
      feature.normal_x = -std::sin(turn);
      feature.normal_y = std::cos(turn);
      const fab::PixelPlace offset{shift * feature.normal_x, shift * feature.normal_y};
      feature.middle = {kMiddle + offset.x_px, kMiddle + offset.y_px};
      if (gaps) {
        feature.rings = {ring(box(-26, half, 26, 20), turn, offset), ring(box(-26, -20, 26, -half), turn, offset)};
      } else {
        feature.rings = {ring(box(-26, -half, 26, half), turn, offset)};
      }
      features.push_back(std::move(feature));
    }
  return features;
}

KeptWidth kept_width(const fab::DoseField& dose, double threshold, const ThinFeature& feature) {
  constexpr double step = 1.0 / 64, reach = 4;
  KeptWidth kept{1e9, 0, 0};
  int lines = 0;
  for (double along = -8; along <= 8; along += 0.31) {
    const double x0 = feature.middle.x_px + along * feature.normal_y,
                 y0 = feature.middle.y_px - along * feature.normal_x;
    double width = 0, before = 0;
    for (double t = -reach; t <= reach; t += step) {
      const double now = std::log(dose.sample({x0 + t * feature.normal_x, y0 + t * feature.normal_y}).dose / threshold);
      if (t > -reach) {
        const bool was_open = (before < 0) == feature.gap, is_open = (now < 0) == feature.gap;
        if (was_open && is_open) width += step;
        if (was_open != is_open) {
          const double cut = before / (before - now);
          width += step * (was_open ? cut : 1 - cut);
        }
      }
      before = now;
    }
    kept.least_px = std::min(kept.least_px, width);
    kept.most_px = std::max(kept.most_px, width);
    kept.mean_px += width;
    ++lines;
  }
  kept.mean_px /= lines;
  return kept;
}

fab::DoseField exposed(const MachineProfile& machine, const fab::Mask& mask, double tau) {
  fab::DoseStream stream{fab::cure_model(machine).value()};
  const fab::MaskExposure exposure{mask.view(), std::chrono::nanoseconds{std::llround(1e9 / tau)}};
  return stream.descend({&exposure, 1}).value();
}

fab::EdgeFigures judge(const MachineProfile& machine, const fab::Mask& mask, double tau,
                       std::span<const Contour> rings) {
  return fab::measure_edges(exposed(machine, mask, tau), 1, {rings, {}}, machine.projection.pixel_pitch_mm, {}).value();
}

fab::Mask binary_mask(const MachineProfile& machine, std::span<const Contour> rings) {
  const PixelSize size = machine.mask_size();
  const auto runs = fab::LayerRuns::from_contours(rings, size, machine.projection.pixel_pitch_mm);
  fab::Mask mask{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)};
  for (std::uint32_t y = 0; y < size.height_px; ++y)
    for (const auto& run : runs.row(y))
      for (std::int32_t x = run.first; x < run.behind; ++x)
        mask.rows[std::size_t{size.height_px - 1 - y} * size.width_px + static_cast<std::size_t>(x)] = 255;
  return mask;
}

}  // namespace telefab::test
