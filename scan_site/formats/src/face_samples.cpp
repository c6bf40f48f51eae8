// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/formats/face_samples.hpp>

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

#include "readers.hpp"

namespace telefab::scan {
namespace {

constexpr double kFarFromCorners =
    6;                              ///< median shortest edges: the middle of a face this far from its corners is bare,
constexpr double kBareShare = 0.2;  ///< and the file says nothing of its surface if this share of the area is
constexpr std::size_t kFewCorners = 300;  ///< a mesh of fewer corners is a drawing, not a scan
constexpr double kAcrossThinnest = 60;    ///< points across the smallest side of the box, between these numbers:
constexpr double kFewestPoints = 100'000, kMostPoints = 400'000;
constexpr double kTriesAPoint = 6;       ///< places tried for a point kept
constexpr double kLeastDistance = 0.75;  ///< of two points, in spacings: what the tries fill to about one a square

struct Triangle {
  Eigen::Vector3d a, b, c;
  [[nodiscard]] Eigen::Vector3d area_vector() const { return (b - a).cross(c - a) / 2; }
};

Triangle triangle_of(const ScanFile& file, std::size_t face) {
  const auto corner = [&](std::size_t k) { return file.cloud.points[file.faces[face][k]].cast<double>(); };
  return {corner(0), corner(1), corner(2)};
}

/// Cells of one spacing, each with the points in it.
class SpacedPoints {
 public:
  SpacedPoints(const Eigen::Vector3d& low, double cell, double least) : low_{low}, cell_{cell}, least_{least * least} {}

  bool try_to_add(const Eigen::Vector3d& p) {
    const Eigen::Array3i at = ((p - low_).array() / cell_).floor().cast<int>();
    for (int k = -1; k <= 1; ++k)
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
          if (const auto found = cells_.find(key(at + Eigen::Array3i{i, j, k})); found != cells_.end())
            for (const Eigen::Vector3d& q : found->second)
              if ((p - q).squaredNorm() < least_) return false;
    cells_[key(at)].push_back(p);
    return true;
  }

 private:
  static std::uint64_t key(const Eigen::Array3i& at) {
    const auto part = [](int v) { return static_cast<std::uint64_t>(static_cast<std::uint32_t>(v + 8)) & 0x1FFFFFU; };
    return part(at.x()) | part(at.y()) << 21U | part(at.z()) << 42U;
  }
  Eigen::Vector3d low_;
  double cell_, least_;
  std::unordered_map<std::uint64_t, std::vector<Eigen::Vector3d>> cells_;  // looked up only, never walked
};

}  // namespace

std::optional<ScanNote> faces_without_points(const ScanFile& file) {
  if (file.faces.empty()) return std::nullopt;
  std::vector<float> shortest;
  std::vector<std::pair<double, double>> faces;  // distance of the middle from the corners, area
  double area = 0;
  for (std::size_t f = 0; f < file.faces.size(); ++f) {
    const Triangle t = triangle_of(file, f);
    const double own = t.area_vector().norm();
    if (!(own > 0)) continue;
    const Eigen::Vector3d middle = (t.a + t.b + t.c) / 3;
    faces.emplace_back(std::min({(t.a - middle).norm(), (t.b - middle).norm(), (t.c - middle).norm()}), own);
    shortest.push_back(static_cast<float>(std::min({(t.a - t.b).norm(), (t.b - t.c).norm(), (t.c - t.a).norm()})));
    area += own;
  }
  if (faces.empty()) return std::nullopt;
  const auto middle = shortest.begin() + static_cast<std::ptrdiff_t>(shortest.size() / 2);
  std::nth_element(shortest.begin(), middle, shortest.end());
  double bare = 0;
  for (const auto& [distance, own] : faces) bare += distance > kFarFromCorners * static_cast<double>(*middle) ? own : 0;
  const std::size_t corners = without_duplicates(file.cloud).size();
  if (bare < kBareShare * area && corners >= kFewCorners) return std::nullopt;
  const std::string what = bare < kBareShare * area
                               ? fmt::format("it has only {} corners", corners)
                               : fmt::format("{:.0f} % of its surface lies far from every corner", 100 * bare / area);
  return ScanNote{ScanRemark::EmptyFaces,
                  fmt::format("the file is a mesh whose faces carry no points ({}), and points are all that is taken: "
                              "the surface between them is a guess. --sample-faces puts points on the faces",
                              what)};
}

Result<PointCloud> sample_faces(const ScanFile& file, std::stop_token stop) {
  if (file.faces.empty())
    return fail(ErrorCode::InvalidInput, "there are no faces to sample: the file holds points only");
  Eigen::Vector3d low = file.cloud.points[0].cast<double>(), high = low;
  for (const auto& p : file.cloud.points) {
    low = low.cwiseMin(p.cast<double>());
    high = high.cwiseMax(p.cast<double>());
  }
  std::vector<double> upto;  // area of the faces so far
  double area = 0;
  for (std::size_t f = 0; f < file.faces.size(); ++f) upto.push_back(area += triangle_of(file, f).area_vector().norm());
  if (!(area > 0)) return fail(ErrorCode::InvalidInput, "the faces of the file have no area to be sampled");
  const double spacing = std::clamp((high - low).minCoeff() / kAcrossThinnest, std::sqrt(area / kMostPoints),
                                    std::sqrt(area / kFewestPoints));

  PointCloud cloud;
  cloud.origin = file.cloud.origin;
  cloud.unit_mm = file.cloud.unit_mm;
  cloud.notes = file.cloud.notes;
  SpacedPoints spaced{low, spacing, kLeastDistance * spacing};
  const auto tries = static_cast<std::uint64_t>(kTriesAPoint * area / (spacing * spacing));
  // Three irrational steps fill the faces evenly, the same on every machine.
  constexpr double kStepArea = 0.8191725133961645, kStepU = 0.6710436067037893, kStepV = 0.5497004779019703;
  for (std::uint64_t i = 0; i < tries; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("sampling faces");
    const auto part = [&](double step) {
      const double v = (static_cast<double>(i) + 0.5) * step;
      return v - std::floor(v);
    };
    const auto at = std::upper_bound(upto.begin(), upto.end(), part(kStepArea) * area);
    const Triangle t = triangle_of(file, static_cast<std::size_t>(std::min(at, upto.end() - 1) - upto.begin()));
    double u = part(kStepU), v = part(kStepV);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const Eigen::Vector3d p = t.a + u * (t.b - t.a) + v * (t.c - t.a);
    if (!spaced.try_to_add(p)) continue;
    cloud.points.push_back(p.cast<float>());
    cloud.normals.push_back(t.area_vector().normalized().cast<float>());
  }
  return cloud;
}

}  // namespace telefab::scan
