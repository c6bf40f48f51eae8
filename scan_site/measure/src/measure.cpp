// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/image/palette.hpp>
#include <telefab/scan/measure/measure.hpp>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <algorithm>
#include <cmath>
#include <limits>

namespace telefab::scan {
namespace {

Box3 box_of(std::span<const Eigen::Vector3f> points) {
  Box3 box = Box3::nothing();
  for (const auto& p : points) box.include(p.cast<double>());
  return box;
}

/// The 24 turns that carry a cube into itself, the identity first.
std::vector<Eigen::Matrix3d> cube_turns() {
  std::vector<Eigen::Matrix3d> turns;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b)
      for (const double sa : {1.0, -1.0})
        for (const double sb : {1.0, -1.0}) {
          if (a == b) continue;
          Eigen::Matrix3d m;
          m.col(0) = sa * Vec3::Unit(a);
          m.col(1) = sb * Vec3::Unit(b);
          m.col(2) = m.col(0).cross(m.col(1));
          turns.push_back(m);
        }
  std::stable_sort(turns.begin(), turns.end(), [](const auto& l, const auto& r) { return l.trace() > r.trace(); });
  return turns;
}

double median_spacing(const KdTree& tree, std::span<const Eigen::Vector3f> points) {
  std::vector<float> gaps;
  std::array<Neighbour, 4> found{};
  const std::size_t step = std::max<std::size_t>(1, points.size() / 2000);
  for (std::size_t i = 0; i < points.size(); i += step)
    if (tree.nearest(points[i], found) == found.size()) gaps.push_back(found[3].squared_distance);
  if (gaps.empty()) return 0;
  const auto middle = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2);
  std::nth_element(gaps.begin(), middle, gaps.end());
  return std::sqrt(static_cast<double>(*middle));
}

Deviation summarise(std::vector<double> d) {
  Deviation out;
  if (d.empty()) return out;
  std::sort(d.begin(), d.end());
  const auto at = [&](double share) {
    return d[static_cast<std::size_t>(share * static_cast<double>(d.size() - 1) + 0.5)];
  };
  out.min = d.front();
  out.max = d.back();
  out.p1 = at(0.01);
  out.p50 = at(0.5);
  out.p99 = at(0.99);
  double sum = 0, square = 0, size = 0;
  for (const double v : d) {
    sum += v;
    square += v * v;
    size += std::abs(v);
  }
  out.bias = sum / static_cast<double>(d.size());
  out.rms = std::sqrt(square / static_cast<double>(d.size()));
  out.size_mean = size / static_cast<double>(d.size());
  for (double& v : d) v = std::abs(v);
  std::sort(d.begin(), d.end());
  out.size_p95 = at(0.95);
  out.size_max = d.back();
  return out;
}

}  // namespace

Result<void> MeasureOptions::validate() const {
  if (height && !(*height > 0)) return fail(ErrorCode::InvalidInput, "the height must be above 0");
  if (max_distance && !(*max_distance > 0)) return fail(ErrorCode::InvalidInput, "max_distance must be above 0");
  return {};
}

Result<Measurement> measure(const PointCloud& reference, const PointCloud& built, const MeasureOptions& options,
                            std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  for (const PointCloud* cloud : {&reference, &built})
    if (cloud->size() < 100 || !cloud->has_normals())
      return fail(ErrorCode::InvalidInput, "measure needs two clouds of 100 or more points with normals");
  const Eigen::Translation3d shift{built.origin - reference.origin};
  const AlignTarget target{reference.points, reference.normals};
  const Box3 box = box_of(reference.points);
  const double size = box.size().norm();
  const double spacing = median_spacing(target.tree, reference.points);
  Measurement result;
  result.height = options.height.value_or(box.size().z());
  if (!(result.height > 0)) return fail(ErrorCode::InvalidInput, "the reference has no height along z; state one");
  result.motion = RigidMotion{shift};
  if (options.align_first) {
    const Vec3 from = box_of(built.points).middle();
    std::vector<RigidMotion> starts{RigidMotion{shift}};
    for (const Eigen::Matrix3d& turn : cube_turns())
      starts.push_back(
          RigidMotion{Eigen::Translation3d{box.middle()} * RigidMotion{turn} * Eigen::Translation3d{-from}});
    std::optional<Alignment> best;
    const double last = std::max(3 * spacing, 0.004 * size);
    const auto score = [&](const Alignment& a) { return a.rms / std::max(a.overlap * a.overlap, 1e-3); };
    for (std::size_t s = 0; s < starts.size(); ++s) {
      const auto rough = align(built.points, built.normals, target, starts[s],
                               {.first_distance = s == 0 ? 0.02 * size : 0.1 * size,
                                .last_distance = last,
                                .max_rounds = 30,
                                .samples = 600},
                               stop);
      if (!rough && rough.error().code == ErrorCode::Cancelled) return tl::unexpected{rough.error()};
      if (rough && (!best || score(*rough) < score(*best))) best = *rough;
      if (s == 0 && best && best->overlap > 0.9 && best->rms < 0.002 * size) break;  // they lay together already
    }
    if (!best || best->overlap < 0.3)
      return fail(ErrorCode::NotConverged, "the two clouds could not be aligned: no start fits a third of the points");
    const auto fine = align(built.points, built.normals, target, best->motion,
                            {.first_distance = last,
                             .last_distance = std::max(2 * spacing, 0.002 * size),
                             .max_rounds = 60,
                             .samples = 20000},
                            stop);
    if (!fine) return tl::unexpected{fine.error()};
    result.motion = fine->motion;
    result.align_rms = fine->rms;
  }

  const double reach = options.max_distance.value_or(0.1 * result.height);
  result.distance.resize(built.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, built.size(), 1024}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const Vec3 p = result.motion * built.points[i].cast<double>();
      const Neighbour near = target.tree.nearest(p.cast<float>());
      const double apart = std::sqrt(static_cast<double>(near.squared_distance));
      if (apart > reach) {
        result.distance[i] = std::numeric_limits<double>::quiet_NaN();
        continue;
      }
      const Vec3 d = p - target.points[near.index].cast<double>();
      const double along = d.dot(target.normals[near.index].cast<double>());
      // within the sampling the plane is the surface; farther off it is not, and the plain distance says more
      result.distance[i] = apart < 2 * spacing ? along : std::copysign(apart, along);
    }
  });
  std::vector<double> compared;
  for (const double d : result.distance)
    if (!std::isnan(d)) compared.push_back(d);
  result.compared = compared.size();
  result.unmatched = built.size() - compared.size();
  if (compared.empty()) return fail(ErrorCode::NotConverged, "no built point lies near the reference");
  result.deviation = summarise(std::move(compared));
  // the motion speaks of file coordinates, not of ours
  result.motion =
      RigidMotion{Eigen::Translation3d{reference.origin} * result.motion * Eigen::Translation3d{-built.origin}};
  return result;
}

std::vector<PointColour> heat_colours(const Measurement& measurement, double range) {
  std::vector<PointColour> colours;
  colours.reserve(measurement.distance.size());
  for (const double d : measurement.distance) {
    if (std::isnan(d)) {
      colours.push_back({110, 110, 110});
      continue;
    }
    const double t = std::clamp(d / range, -1.0, 1.0);
    const Colour colour = palette::deviation_colour(t);
    colours.push_back({colour.red, colour.green, colour.blue});
  }
  return colours;
}

std::string to_json(const Measurement& m) {
  const Deviation& d = m.deviation;
  std::string motion;
  for (int r = 0; r < 4; ++r)
    motion += fmt::format("{}[{:.9g},{:.9g},{:.9g},{:.9g}]", r ? "," : "", m.motion.matrix()(r, 0),
                          m.motion.matrix()(r, 1), m.motion.matrix()(r, 2), m.motion.matrix()(r, 3));
  const double percent = 100 / m.height;
  return fmt::format(
      R"({{"height":{:.6g},"compared":{},"unmatched":{},"align_rms":{:.6g},"deviation":{{"min":{:.6g},"max":{:.6g},"p1":{:.6g},"p50":{:.6g},"p99":{:.6g},"rms":{:.6g},"bias":{:.6g}}},"size":{{"mean":{:.6g},"p95":{:.6g},"max":{:.6g}}},"percent_of_height":{{"min":{:.4f},"max":{:.4f},"p1":{:.4f},"p50":{:.4f},"p99":{:.4f},"rms":{:.4f},"bias":{:.4f}}},"built_to_reference":[{}]}})",
      m.height, m.compared, m.unmatched, m.align_rms, d.min, d.max, d.p1, d.p50, d.p99, d.rms, d.bias, d.size_mean,
      d.size_p95, d.size_max, d.min * percent, d.max * percent, d.p1 * percent, d.p50 * percent, d.p99 * percent,
      d.rms * percent, d.bias * percent, motion);
}

}  // namespace telefab::scan
