// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <numbers>
#include <random>
#include <telefab/geometry/layer.hpp>

namespace telefab::test {

/// A stack of wavy stars with holes that drift from layer to layer, certified, every fifth in part completed; `seed`
/// decides everything.
[[nodiscard]] inline LayerStack random_stack(std::uint64_t seed, std::uint32_t layer_count) {
  std::mt19937_64 rng{seed};
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(rng() >> 11U) * 0x1p-53;
  };
  StackHeader header;
  header.machine = "machine-a";
  header.scan_name = "star-" + std::to_string(seed) + ".ply";
  header.layer_thickness_mm = 0.15;
  header.pixel_pitch_mm = 0.14;
  header.layer_count = layer_count;
  header.bounds = {{0, 0}, {260, 160}};
  const int stars = 1 + static_cast<int>(rng() % 3);
  const double wave = uniform(3, 9);
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < layer_count; ++i) {
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = cut_height_mm(layer.index, header.layer_thickness_mm);
    layer.certificate.verdict = LayerCertificate::Verdict::Measured;
    layer.certificate.method = LayerCertificate::Method::Grid;
    for (int s = 0; s < stars; ++s) {
      const auto ring = [&](double radius_mm, bool hole) {
        std::vector<Point2> vertices;
        const int n = 60 + static_cast<int>(rng() % 60);
        for (int k = 0; k < n; ++k) {
          const double angle = 2 * std::numbers::pi * (hole ? n - k : k) / n;
          const double r = radius_mm * (1 + 0.1 * std::sin(wave * angle + 0.02 * i));
          vertices.push_back({50 + 70.0 * s + 0.05 * i + r * std::cos(angle), 80 + r * std::sin(angle)});
        }
        layer.contours.push_back(Contour::from_vertices(std::move(vertices)).value());
      };
      ring(25, false);
      if (rng() % 2) ring(8, true);
    }
    for (const Contour& contour : layer.contours) layer.certificate.measured_euler += contour.is_hole() ? -1 : 1;
    if (rng() % 2) layer.certificate.predicted_euler = layer.certificate.measured_euler;
    if (rng() % 16 == 0) {
      layer.certificate.flag({.reason = DoubtReason::KernelsDisagree,
                              .place = Point2{uniform(0, 260), uniform(0, 160)},
                              .size_mm = 0.512,
                              .other_mm = 0.64,
                              .found = {1, static_cast<int>(rng() % 3)},
                              .other = {2, 0}});
    }
    if (i % 5 == 3) {
      // A third of the first ring is completed; of a flagged layer doubtful.
      const auto n = static_cast<std::uint32_t>(layer.contours[0].vertices().size());
      const bool flagged = layer.certificate.verdict == LayerCertificate::Verdict::Doubtful;
      const SurfaceRun gap{flagged ? SurfaceClass::Doubtful : SurfaceClass::Completed, n / 3, 1.25 + 0.01 * i, 0.37};
      const std::vector<SurfaceRun> runs{{SurfaceClass::Measured, n - n / 3 - 5}, gap, {SurfaceClass::Measured, 5}};
      layer.contours[0] = layer.contours[0].with_runs(runs).value();
      if (!flagged) layer.certificate.verdict = LayerCertificate::Verdict::Completed;
    }
    layers.push_back(std::move(layer));
  }
  return LayerStack::from_layers(std::move(header), std::move(layers)).value();
}

}  // namespace telefab::test
