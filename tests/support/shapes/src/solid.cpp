// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <telefab/test/solid.hpp>
#include <unordered_map>

namespace telefab::test {
namespace {

constexpr int kDartsACell = 12;
constexpr double kNearest = 0.75;

Vec3 gradient_at(const Solid& solid, const Vec3& p, double step) {
  Vec3 g;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 way = step * Vec3::Unit(axis);
    g[axis] = (solid.distance_mm(p + way) - solid.distance_mm(p - way)) / (2 * step);
  }
  return g;
}

scan::Box3 box_about(const Vec3& half) { return {-half, half}; }

}  // namespace

Solid solid_ball(const Vec3& centre_mm, double radius_mm) {
  const Vec3 half = Vec3::Constant(radius_mm);
  return {[=](const Vec3& p) { return (p - centre_mm).norm() - radius_mm; }, {centre_mm - half, centre_mm + half}};
}

Solid solid_pin(const Vec3& from_mm, const Vec3& to_mm, double radius_mm) {
  const Vec3 half = Vec3::Constant(radius_mm);
  return {[=](const Vec3& p) {
            const Vec3 way = to_mm - from_mm;
            const double t = std::clamp((p - from_mm).dot(way) / way.squaredNorm(), 0.0, 1.0);
            return (p - from_mm - t * way).norm() - radius_mm;
          },
          {from_mm.cwiseMin(to_mm) - half, from_mm.cwiseMax(to_mm) + half}};
}

Solid solid_box(const Vec3& half_sizes_mm, double edge_mm) {
  return {[=](const Vec3& p) {
            const Vec3 q = p.cwiseAbs() - half_sizes_mm + Vec3::Constant(edge_mm);
            return q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0) - edge_mm;
          },
          box_about(half_sizes_mm)};
}

Solid solid_ring(double ring_mm, double tube_mm) {
  return {[=](const Vec3& p) { return std::hypot(std::hypot(p.x(), p.y()) - ring_mm, p.z()) - tube_mm; },
          box_about({ring_mm + tube_mm, ring_mm + tube_mm, tube_mm})};
}

Solid solid_spring(double radius_mm, double wire_mm, double pitch_mm, double turns) {
  const double rise = pitch_mm / (2 * std::numbers::pi);  // a radian
  const double steep = radius_mm / std::hypot(radius_mm, rise);
  const double whole = 2 * std::numbers::pi * turns;
  const auto on_wire = [=](double t) { return Vec3{radius_mm * std::cos(t), radius_mm * std::sin(t), rise * t}; };
  return {[=](const Vec3& p) {
            double nearest = std::min((p - on_wire(0)).norm(), (p - on_wire(whole)).norm());
            const double angle = std::atan2(p.y(), p.x());
            const double first = std::round((p.z() / rise - angle) / (2 * std::numbers::pi));
            for (const double k : {first - 1, first, first + 1}) {
              const double t = angle + 2 * std::numbers::pi * k;
              if (t < 0 || t > whole) continue;
              nearest = std::min(nearest, std::hypot(std::hypot(p.x(), p.y()) - radius_mm, steep * (p.z() - rise * t)));
            }
            return nearest - wire_mm;
          },
          {{-radius_mm - wire_mm, -radius_mm - wire_mm, -2 * wire_mm},
           {radius_mm + wire_mm, radius_mm + wire_mm, pitch_mm * turns + 2 * wire_mm}}};
}

Solid joined(Solid a, Solid b) {
  const scan::Box3 box{a.box.min.cwiseMin(b.box.min), a.box.max.cwiseMax(b.box.max)};
  return {[first = std::move(a.distance_mm), second = std::move(b.distance_mm)](const Vec3& p) {
            return std::min(first(p), second(p));
          },
          box};
}

Solid turned(Solid solid, double degrees, const Vec3& axis) {
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd{degrees * std::numbers::pi / 180, axis.normalized()}.toRotationMatrix();
  scan::Box3 box{Vec3::Constant(1e9), Vec3::Constant(-1e9)};
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 at{(corner & 1 ? solid.box.max : solid.box.min).x(), (corner & 2 ? solid.box.max : solid.box.min).y(),
                  (corner & 4 ? solid.box.max : solid.box.min).z()};
    box.min = box.min.cwiseMin(turn * at);
    box.max = box.max.cwiseMax(turn * at);
  }
  return {[turn, inner = std::move(solid.distance_mm)](const Vec3& p) { return inner(turn.transpose() * p); }, box};
}

Solid shifted(Solid solid, const Vec3& by_mm) {
  return {[by_mm, inner = std::move(solid.distance_mm)](const Vec3& p) { return inner(p - by_mm); },
          {solid.box.min + by_mm, solid.box.max + by_mm}};
}

SurfaceSamples sample_solid(const Solid& solid, double spacing_mm, std::uint64_t seed) {
  std::mt19937_64 random{seed};
  const auto uniform = [&] { return (static_cast<double>(random() >> 11U) + 0.5) * 0x1p-53; };
  const Vec3 low = solid.box.min - Vec3::Constant(spacing_mm);
  const Eigen::Array3i count =
      ((solid.box.max - low + Vec3::Constant(spacing_mm)) / spacing_mm).array().ceil().cast<int>();
  std::vector<Vec3> darts;
  for (int k = 0; k < count.z(); ++k)
    for (int j = 0; j < count.y(); ++j)
      for (int i = 0; i < count.x(); ++i) {
        const Vec3 corner =
            low + spacing_mm * Vec3{static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)};
        if (std::abs(solid.distance_mm(corner + Vec3::Constant(spacing_mm / 2))) > 1.2 * spacing_mm) continue;
        for (int d = 0; d < kDartsACell; ++d)
          darts.push_back(corner + spacing_mm * Vec3{uniform(), uniform(), uniform()});
      }
  for (std::size_t i = darts.size(); i > 1; --i) std::swap(darts[i - 1], darts[random() % i]);

  const double nearest = kNearest * spacing_mm;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells;
  const auto cell = [&](const Vec3& p, int axis) {
    return static_cast<std::int64_t>(std::floor((p[axis] - low[axis]) / nearest));
  };
  const auto key = [](std::int64_t i, std::int64_t j, std::int64_t k) {
    return static_cast<std::uint64_t>((i + 4) << 42 | (j + 4) << 21 | (k + 4));
  };
  SurfaceSamples samples;
  const double step = 1e-4 * spacing_mm;
  const auto has_within = [&](const Vec3& p, double reach) {
    for (std::int64_t a = -1; a <= 1; ++a)
      for (std::int64_t b = -1; b <= 1; ++b)
        for (std::int64_t c = -1; c <= 1; ++c)
          if (const auto at = cells.find(key(cell(p, 0) + a, cell(p, 1) + b, cell(p, 2) + c)); at != cells.end())
            for (const std::size_t other : at->second)
              if ((samples.points[other] - p).squaredNorm() < reach * reach) return true;
    return false;
  };
  for (Vec3 p : darts) {
    for (int n = 0; n < 6; ++n) {
      const double off = solid.distance_mm(p);
      if (std::abs(off) <= 1e-4 * spacing_mm || (n == 1 && has_within(p, 0.5 * nearest))) break;
      const Vec3 g = gradient_at(solid, p, step);
      p -= off * g / std::max(g.squaredNorm(), 0.1);
    }
    if (std::abs(solid.distance_mm(p)) > 1e-4 * spacing_mm || has_within(p, nearest)) continue;
    cells[key(cell(p, 0), cell(p, 1), cell(p, 2))].push_back(samples.points.size());
    samples.points.push_back(p);
    samples.normals.push_back(gradient_at(solid, p, step).normalized());
  }
  samples.area_mm2 = static_cast<double>(samples.points.size()) * spacing_mm * spacing_mm;
  return samples;
}

SliceCount count_slice(const Solid& solid, double z_mm, double pitch_mm, double offset_mm) {
  const Vec3 more = Vec3::Constant(std::abs(offset_mm));
  return count_slice(
      {solid.box.min - more, solid.box.max + more}, [&](const Vec3& p) { return solid.distance_mm(p) < offset_mm; },
      z_mm, pitch_mm);
}

}  // namespace telefab::test
