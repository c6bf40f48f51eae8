// SPDX-License-Identifier: GPL-3.0-or-later
#include "lump.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

namespace telefab::scan {
namespace {

DigitizeModel star_mesh(const std::function<double(double, double)>& radius) {
  constexpr std::uint32_t kRings = 80, kSpokes = 160;
  DigitizeModel model;
  for (std::uint32_t i = 0; i <= kRings; ++i)
    for (std::uint32_t j = 0; j < kSpokes; ++j) {
      const double theta = std::numbers::pi * i / kRings, phi = 2 * std::numbers::pi * j / kSpokes;
      const double r = radius(theta, phi);
      model.points.emplace_back(r * std::sin(theta) * std::cos(phi), 0.8 * r * std::sin(theta) * std::sin(phi),
                                1.2 * r * std::cos(theta));
    }
  for (std::uint32_t i = 0; i < kRings; ++i)
    for (std::uint32_t j = 0; j < kSpokes; ++j) {
      const std::uint32_t a = i * kSpokes + j, b = i * kSpokes + (j + 1) % kSpokes, c = a + kSpokes, d = b + kSpokes;
      model.triangles.push_back({a, c, d});
      model.triangles.push_back({a, d, b});
    }
  return model;
}

}  // namespace

DigitizeModel lump_mesh() {
  return star_mesh([](double theta, double phi) {
    return 24 + 4 * std::sin(3 * phi + 0.4) * std::sin(theta) + 3 * std::cos(2 * theta + 1) +
           2 * std::sin(5 * phi) * std::sin(2 * theta) + 3 * std::cos(phi) * std::sin(theta);
  });
}

namespace {

struct Bump {
  double theta, phi, height_mm, width_rad;
};
constexpr std::array kBumps{Bump{0.4, 0.3, 5, 0.30},  Bump{0.9, 2.2, -4, 0.25}, Bump{1.3, 0.9, 4, 0.20},
                            Bump{1.5, 3.0, 6, 0.35},  Bump{1.1, 4.4, 3, 0.18},  Bump{1.8, 5.4, 5, 0.25},
                            Bump{2.0, 1.7, -3, 0.20}, Bump{2.3, 3.9, 4, 0.30},  Bump{2.6, 0.2, 3, 0.20},
                            Bump{0.8, 5.6, 3, 0.22},  Bump{1.7, 0.1, -4, 0.22}, Bump{2.7, 2.4, 5, 0.28}};

double height_at(const Bump& b, double theta, double phi, bool other_side) {
  const auto direction = [](double t, double p) {
    return Vec3{std::sin(t) * std::cos(p), std::sin(t) * std::sin(p), std::cos(t)};
  };
  const double cosine = direction(theta, phi).dot(direction(b.theta, other_side ? -b.phi : b.phi));
  const double angle = std::acos(std::clamp(cosine, -1.0, 1.0)) / b.width_rad;
  return b.height_mm * std::exp(-angle * angle);
}

}  // namespace

DigitizeModel knobbly_mesh() {
  return star_mesh([](double theta, double phi) {
    double r = 25;
    for (const Bump& b : kBumps) r += height_at(b, theta, phi, false);
    return r;
  });
}

DigitizeModel near_symmetric_mesh(double asymmetry_mm) {
  return star_mesh([asymmetry_mm](double theta, double phi) {
    double r = 25 + asymmetry_mm * std::sin(2 * phi) * std::sin(theta);
    for (const Bump& b : kBumps) r += height_at(b, theta, phi, false) + height_at(b, theta, phi, true);
    return r;
  });
}

Scene scene_of(const DigitizeModel& model, const DigitizeOptions& options) {
  Scene made;
  const auto views = digitize(model, options, {});
  EXPECT_TRUE(views) << views.error().what;
  for (const VirtualView& v : *views) {
    ScanFile file;
    file.cloud.points = v.points;
    file.views.push_back(v.view);
    auto image = make_range_image(file, 0, "view_" + std::to_string(made.images.size()));
    EXPECT_TRUE(image) << image.error().what;
    made.images.push_back(std::move(*image));
    made.truth.push_back(views->front().scanner_to_model.inverse() * v.scanner_to_model);
    made.to_model.push_back(v.scanner_to_model);
  }
  return made;
}

DigitizeModel moved(DigitizeModel model, const RigidMotion& motion) {
  for (Vec3& p : model.points) p = motion * p;
  return model;
}

}  // namespace telefab::scan
