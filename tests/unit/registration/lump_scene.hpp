// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>
#include <cmath>
#include <numbers>
#include <string>
#include <telefab/scan/digitize/digitize.hpp>
#include <telefab/scan/registration/register_views.hpp>
#include <vector>

// A body without symmetry and what a turntable shows of it: shared by the tests of registration.
namespace telefab::scan {

/// A lump without symmetry, about 60 mm across, as a mesh of latitudes and longitudes.
inline Vec3 lump(double theta, double phi) {
  const double r = 24 + 4 * std::sin(3 * phi + 0.4) * std::sin(theta) + 3 * std::cos(2 * theta + 1) +
                   2 * std::sin(5 * phi) * std::sin(2 * theta) + 3 * std::cos(phi) * std::sin(theta);
  return {r * std::sin(theta) * std::cos(phi), 0.8 * r * std::sin(theta) * std::sin(phi), 1.2 * r * std::cos(theta)};
}

inline DigitizeModel lump_mesh() {
  constexpr std::uint32_t kRings = 80, kSpokes = 160;
  DigitizeModel model;
  for (std::uint32_t i = 0; i <= kRings; ++i)
    for (std::uint32_t j = 0; j < kSpokes; ++j)
      model.points.push_back(lump(std::numbers::pi * i / kRings, 2 * std::numbers::pi * j / kSpokes));
  for (std::uint32_t i = 0; i < kRings; ++i)
    for (std::uint32_t j = 0; j < kSpokes; ++j) {
      const std::uint32_t a = i * kSpokes + j, b = i * kSpokes + (j + 1) % kSpokes, c = a + kSpokes, d = b + kSpokes;
      model.triangles.push_back({a, c, d});
      model.triangles.push_back({a, d, b});
    }
  return model;
}

struct Scene {
  std::vector<RangeImage> images;
  std::vector<RigidMotion> truth;  ///< view to the frame of view 0
};

inline Scene scene(const DigitizeOptions& options) {
  Scene made;
  const auto views = digitize(lump_mesh(), options, {});
  EXPECT_TRUE(views) << views.error().what;
  for (const VirtualView& v : *views) {
    ScanFile file;
    file.cloud.points = v.points;
    file.views.push_back(v.view);
    auto image = make_range_image(file, 0, "view_" + std::to_string(made.images.size()));
    EXPECT_TRUE(image) << image.error().what;
    made.images.push_back(std::move(*image));
    made.truth.push_back(views->front().scanner_to_model.inverse() * v.scanner_to_model);
  }
  return made;
}

}  // namespace telefab::scan
