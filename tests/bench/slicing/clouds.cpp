// SPDX-License-Identifier: GPL-3.0-or-later
#include "clouds.hpp"

#include <cmath>
#include <numbers>
#include <random>
#include <telefab/test/analytic_field.hpp>

namespace telefab::bench {
namespace {

using scan::Vec3;

constexpr double kTurn = 2 * std::numbers::pi;

/// Circles of the tube one spacing apart, samples on them one spacing apart, each moved by up to 0.2 spacings.
void torus(std::size_t points, const SampleSink& sink) {
  constexpr double kRing = 35;
  constexpr double kTube = 15;
  const double spacing = std::sqrt(kTurn * kTurn * kRing * kTube / static_cast<double>(points));
  std::mt19937_64 random{1};
  const auto jitter = [&] { return 0.2 * spacing * (static_cast<double>(random() >> 11U) * 0x1p-52 - 1); };
  const auto circles = static_cast<int>(std::lround(kTurn * kTube / spacing));
  for (int c = 0; c < circles; ++c) {
    const double around = kTurn * c / circles;
    const double radius = kRing + kTube * std::cos(around);
    const auto count = static_cast<int>(std::lround(kTurn * radius / spacing));
    const double phase = kTurn * static_cast<double>(random() >> 11U) * 0x1p-53;
    for (int i = 0; i < count; ++i) {
      const double v = around + jitter() / kTube;
      const double u = phase + kTurn * i / count + jitter() / radius;
      const Vec3 normal{std::cos(v) * std::cos(u), std::sin(v), std::cos(v) * std::sin(u)};
      const Vec3 spine{kRing * std::cos(u), 0, kRing * std::sin(u)};
      sink(spine + kTube * normal, normal);
    }
  }
}

/// Rays turned by the golden angle, about 100 mm across.
void bumpy(std::size_t points, const SampleSink& sink) {
  const auto shape = test::bumpy(47, 1);
  const auto cursor = shape->cursor();
  for (std::size_t i = 0; i < points; ++i) {
    const double u = 2 * (static_cast<double>(i) + 0.5) / static_cast<double>(points) - 1;
    const double a = 2.399963229728653 * static_cast<double>(i);
    const Vec3 ray{std::sqrt(1 - u * u) * std::cos(a), std::sqrt(1 - u * u) * std::sin(a), u};
    Vec3 p = 47 * ray;
    scan::FieldSample f = cursor->at(p);
    for (int k = 0; k < 6; ++k) {
      p -= f.value_mm / f.gradient.dot(ray) * ray;
      f = cursor->at(p);
    }
    sink(p, f.gradient.normalized());
  }
}

}  // namespace

void for_each_sample(CloudKind kind, std::size_t points, const SampleSink& sink) {
  kind == CloudKind::Torus ? torus(points, sink) : bumpy(points, sink);
}

scan::PointCloud make_cloud(CloudKind kind, std::size_t points) {
  scan::PointCloud cloud;
  cloud.points.reserve(points + points / 64);
  cloud.normals.reserve(points + points / 64);
  for_each_sample(kind, points, [&](const Vec3& p, const Vec3& normal) {
    cloud.points.push_back(p.cast<float>());
    cloud.normals.push_back(normal.cast<float>());
  });
  cloud.origin = {70, 50, 50};
  return cloud;
}

}  // namespace telefab::bench
