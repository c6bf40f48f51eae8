// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <telefab/scan/digitize/models.hpp>

namespace telefab::scan {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// Triangles over a grid of `across` x `around` places; around closes, across only where asked.
DigitizeModel woven(std::uint32_t across, std::uint32_t around, bool closes_across,
                    const std::function<Vec3(double, double)>& place) {
  DigitizeModel model;
  const std::uint32_t rows = closes_across ? across : across + 1;
  for (std::uint32_t i = 0; i < rows; ++i)
    for (std::uint32_t j = 0; j < around; ++j)
      model.points.push_back(place(static_cast<double>(i) / across, static_cast<double>(j) / around));
  const auto at = [&](std::uint32_t i, std::uint32_t j) { return (i % rows) * around + j % around; };
  for (std::uint32_t i = 0; i < across; ++i)
    for (std::uint32_t j = 0; j < around; ++j) {
      model.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      model.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return model;
}

DigitizeModel sphere() {
  return woven(180, 360, false, [](double u, double v) {
    const double polar = std::numbers::pi * (1 - u), turn = kTurn * v;
    return Vec3{-std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), std::cos(polar)};
  });
}

/// A tube of `radius` along a closed line, frames carried by the line's distance from the z axis.
DigitizeModel tube(double radius, const std::function<Vec3(double)>& line) {
  return woven(900, 120, true, [&](double u, double v) {
    const Vec3 middle = line(u);
    const Vec3 ahead = (line(u + 1e-5) - line(u - 1e-5)).normalized();
    const Vec3 side = ahead.cross(Vec3{middle.x(), middle.y(), 0.3 * middle.z()}).normalized();
    const Vec3 out = side.cross(ahead);
    return Vec3{middle + radius * (std::cos(kTurn * v) * out - std::sin(kTurn * v) * side)};
  });
}

}  // namespace

Result<DigitizeModel> shape_model(std::string_view name, double height_mm) {
  DigitizeModel model;
  if (name == "sphere")
    model = sphere();
  else if (name == "torus")
    model = tube(0.42, [](double u) { return Vec3{std::cos(kTurn * u), 0.0, std::sin(kTurn * u)}; });
  else if (name == "knot")
    model = tube(0.36, [](double u) {
      const double t = kTurn * u;
      return Vec3{std::sin(t) + 2 * std::sin(2 * t), std::cos(t) - 2 * std::cos(2 * t), -1.6 * std::sin(3 * t)};
    });
  else
    return fail(ErrorCode::InvalidInput, fmt::format("no shape named \"{}\"; there are sphere, torus, knot", name));
  scale_to_height(model, height_mm);
  double low = model.points[0].z();
  for (const Vec3& p : model.points) low = std::min(low, p.z());
  for (Vec3& p : model.points) p.z() -= low;
  return model;
}

Result<DigitizeModel> surfel_model(const PointCloud& cloud) {
  if (cloud.size() < 16 || !cloud.has_normals())
    return fail(ErrorCode::InvalidInput,
                "a cloud is digitized by squares on its points: it needs 16 points or more, with normals");
  const KdTree tree{cloud.points};
  DigitizeModel model;
  model.points.reserve(4 * cloud.size());
  model.triangles.reserve(2 * cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 normal = cloud.normals[i].cast<double>().normalized();
    std::array<Neighbour, 7> near;  // the first is the point itself
    const std::size_t found = tree.nearest(cloud.points[i], near);
    const Vec3 along = normal.unitOrthogonal() * (0.6 * std::sqrt(near[found - 1].squared_distance));
    const Vec3 aside = normal.cross(along);
    const Vec3 middle = cloud.origin + cloud.points[i].cast<double>();
    const auto first = static_cast<std::uint32_t>(model.points.size());
    for (const Vec3& corner : {Vec3{-along - aside}, Vec3{along - aside}, Vec3{along + aside}, Vec3{-along + aside}})
      model.points.push_back(middle + corner);
    model.triangles.push_back({first, first + 1, first + 2});
    model.triangles.push_back({first, first + 2, first + 3});
  }
  return model;
}

bool face_outward(DigitizeModel& model) {
  if (model.points.empty()) return false;
  // From a place in its middle, so that an open surface has a sign as well.
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : model.points) middle += p / static_cast<double>(model.points.size());
  double volume = 0;
  for (const auto& t : model.triangles)
    volume += (model.points[t[0]] - middle).dot((model.points[t[1]] - middle).cross(model.points[t[2]] - middle));
  if (volume >= 0) return false;
  for (auto& t : model.triangles) std::swap(t[1], t[2]);
  return true;
}

void scale_to_height(DigitizeModel& model, double height_mm) {
  double low = model.points.at(0).z(), high = low;
  for (const Vec3& p : model.points) {
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  const double scale = height_mm / (high - low);
  for (Vec3& p : model.points) p *= scale;
}

PointCloud reference_cloud(const DigitizeModel& model, double spacing_mm, std::uint64_t seed) {
  std::mt19937_64 random{seed};
  const auto uniform = [&] { return static_cast<double>(random() >> 11U) * 0x1p-53; };
  PointCloud cloud;
  double owed = 0;
  for (const auto& t : model.triangles) {
    const Vec3& a = model.points[t[0]];
    const Vec3 ab = model.points[t[1]] - a, ac = model.points[t[2]] - a;
    const Vec3 normal = ab.cross(ac);
    const double area = normal.norm() / 2;
    if (!(area > 0)) continue;
    for (owed += area / (spacing_mm * spacing_mm); owed >= 1; owed -= 1) {
      double u = uniform(), v = uniform();
      if (u + v > 1) u = 1 - u, v = 1 - v;
      cloud.points.push_back((a + u * ab + v * ac).cast<float>());
      cloud.normals.push_back((normal / (2 * area)).cast<float>());
    }
  }
  return cloud;
}

}  // namespace telefab::scan
