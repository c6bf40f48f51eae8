// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/file.hpp>
#include <telefab/test/mesh_truth.hpp>

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <random>
#include <unordered_map>

namespace telefab::test {
namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

std::uint64_t directed(std::uint32_t a, std::uint32_t b) { return std::uint64_t{a} << 32U | b; }

}  // namespace

struct MeshTruth::Nearest {
  Triangles triangles;
  Tree tree;
};

MeshTruth::~MeshTruth() = default;
MeshTruth::MeshTruth(MeshTruth&&) noexcept = default;

MeshTruth::MeshTruth(std::span<const Vec3> corners, std::span<const std::array<std::uint32_t, 3>> faces) {
  std::map<std::array<double, 3>, std::uint32_t> places;
  std::vector<std::uint32_t> number;
  for (const Vec3& p : corners) {
    const auto [at, fresh] = places.try_emplace({p.x(), p.y(), p.z()}, static_cast<std::uint32_t>(corners_.size()));
    if (fresh) corners_.push_back(p);
    number.push_back(at->second);
  }
  double volume = 0;
  for (const auto& f : faces) {
    const std::array<std::uint32_t, 3> t{number[f[0]], number[f[1]], number[f[2]]};
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
    faces_.push_back(t);
    volume += corners_[t[0]].dot(corners_[t[1]].cross(corners_[t[2]]));
  }
  outward_ = volume < 0 ? -1 : 1;
}

bool MeshTruth::closed() const {
  std::unordered_map<std::uint64_t, int> edges;
  for (const auto& f : faces_)
    for (std::size_t k = 0; k < 3; ++k) ++edges[directed(f[k], f[(k + 1) % 3])];
  return !edges.empty() && std::all_of(edges.begin(), edges.end(), [&](const auto& e) {
    const auto back = edges.find(e.first << 32U | e.first >> 32U);
    return e.second == 1 && back != edges.end();
  });
}

int MeshTruth::euler() const {
  std::vector<bool> used(corners_.size());
  for (const auto& f : faces_)
    for (const std::uint32_t c : f) used[c] = true;
  return static_cast<int>(std::count(used.begin(), used.end(), true)) - static_cast<int>(faces_.size()) / 2;
}

MeshTruth MeshTruth::moved(const Transform4& m) const {
  std::vector<Vec3> corners;
  for (const Vec3& p : corners_)
    corners.emplace_back(m[0] * p.x() + m[1] * p.y() + m[2] * p.z() + m[3],
                         m[4] * p.x() + m[5] * p.y() + m[6] * p.z() + m[7],
                         m[8] * p.x() + m[9] * p.y() + m[10] * p.z() + m[11]);
  return {corners, faces_};
}

RingCount MeshTruth::rings(double z, double least_width) const {
  const auto above = [&](std::uint32_t c) { return corners_[c].z() > z; };
  // A face hands the section from the edge where it enters to the edge where it leaves.
  std::unordered_map<std::uint64_t, std::uint64_t> next;
  const auto key = [](std::uint32_t a, std::uint32_t b) { return directed(std::min(a, b), std::max(a, b)); };
  for (const auto& f : faces_) {
    std::uint64_t up = 0, down = 0;
    bool crosses = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = f[k], b = f[(k + 1) % 3];
      if (above(a) == above(b)) continue;
      crosses = true;
      (above(b) ? up : down) = key(a, b);
    }
    if (crosses) next[down] = up;
  }
  const auto place = [&](std::uint64_t edge) {
    const Vec3& a = corners_[edge >> 32U];
    const Vec3& b = corners_[edge & 0xFFFFFFFFU];
    return Vec3{a + (z - a.z()) / (b.z() - a.z()) * (b - a)};
  };
  RingCount count;
  while (!next.empty()) {
    const Vec3 first = place(next.begin()->first);
    double area = 0, length = 0;
    Vec3 last = first;
    for (auto at = next.begin(); at != next.end();) {
      const std::uint64_t to = at->second;
      next.erase(at);
      const Vec3 p = place(to);
      area += (last - first).head<2>().x() * (p - first).y() - (last - first).y() * (p - first).x();
      length += (p - last).norm();
      last = p;
      at = next.find(to);
    }
    // Half the area of the fan times four over the length: the diameter of a circle, twice the width of a strip.
    if (2 * std::abs(area) < least_width * length) continue;
    // Counter-clockwise around solid when the faces point outward.
    ++(area * outward_ > 0 ? count.outers : count.holes);
  }
  return count;
}

std::vector<std::array<Point2, 2>> MeshTruth::section(double z) const {
  std::vector<std::array<Point2, 2>> segments;
  const auto place = [&](std::uint32_t i, std::uint32_t j) {
    // From below always, so that neighbours meet in the same point.
    const Vec3& a = corners_[corners_[i].z() <= corners_[j].z() ? i : j];
    const Vec3& b = corners_[corners_[i].z() <= corners_[j].z() ? j : i];
    const Vec3 p = a + (z - a.z()) / (b.z() - a.z()) * (b - a);
    return Point2{p.x(), p.y()};
  };
  for (const auto& f : faces_) {
    std::array<Point2, 2> segment{};
    bool crosses = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = f[k], b = f[(k + 1) % 3];
      if ((corners_[a].z() > z) == (corners_[b].z() > z)) continue;
      crosses = true;
      segment[corners_[b].z() > z ? 1 : 0] = place(a, b);
    }
    if (!crosses) continue;
    if (outward_ < 0) std::swap(segment[0], segment[1]);
    segments.push_back(segment);
  }
  return segments;
}

double MeshTruth::distance(const Vec3& place) const {
  if (!nearest_) {
    nearest_ = std::make_unique<Nearest>();
    const auto point = [&](std::uint32_t c) {
      return Kernel::Point_3{corners_[c].x(), corners_[c].y(), corners_[c].z()};
    };
    for (const auto& f : faces_) {
      const Kernel::Triangle_3 t{point(f[0]), point(f[1]), point(f[2])};
      if (!t.is_degenerate()) nearest_->triangles.push_back(t);
    }
    nearest_->tree.insert(nearest_->triangles.begin(), nearest_->triangles.end());
    nearest_->tree.accelerate_distance_queries();
  }
  return std::sqrt(nearest_->tree.squared_distance({place.x(), place.y(), place.z()}));
}

std::vector<Vec3> MeshTruth::corner_normals() const {
  std::vector<Vec3> normals(corners_.size(), Vec3::Zero());
  for (const auto& f : faces_) {
    const Vec3 n = outward_ * (corners_[f[1]] - corners_[f[0]]).cross(corners_[f[2]] - corners_[f[0]]);
    for (const std::uint32_t c : f) normals[c] += n;
  }
  for (Vec3& n : normals) n = n.norm() > 0 ? Vec3{n.normalized()} : Vec3{Vec3::UnitZ()};
  return normals;
}

scan::PointCloud MeshTruth::as_scanned() const {
  scan::PointCloud cloud;
  for (const Vec3& p : corners_) cloud.points.push_back(p.cast<float>());
  for (const Vec3& n : corner_normals()) cloud.normals.push_back(n.cast<float>());
  return cloud;
}

double MeshTruth::area() const {
  double area = 0;
  for (const auto& f : faces_)
    area += (corners_[f[1]] - corners_[f[0]]).cross(corners_[f[2]] - corners_[f[0]]).norm() / 2;
  return area;
}

scan::PointCloud MeshTruth::sampled(std::size_t count, double noise, double normal_noise, std::uint64_t seed) const {
  std::vector<double> until;
  for (const auto& f : faces_)
    until.push_back((until.empty() ? 0 : until.back()) +
                    (corners_[f[1]] - corners_[f[0]]).cross(corners_[f[2]] - corners_[f[0]]).norm() / 2);
  const std::vector<Vec3> normals = corner_normals();
  std::mt19937_64 random{seed};
  std::uniform_real_distribution<double> even;
  std::normal_distribution<double> bell;
  scan::PointCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const auto at = std::upper_bound(until.begin(), until.end() - 1, even(random) * until.back());
    const auto& f = faces_[static_cast<std::size_t>(at - until.begin())];
    double u = even(random), v = even(random);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    Vec3 p = (1 - u - v) * corners_[f[0]] + u * corners_[f[1]] + v * corners_[f[2]];
    Vec3 n = (1 - u - v) * normals[f[0]] + u * normals[f[1]] + v * normals[f[2]];
    p += noise * Vec3{bell(random), bell(random), bell(random)};
    n = n.normalized() + normal_noise * Vec3{bell(random), bell(random), bell(random)};
    cloud.points.push_back(p.cast<float>());
    cloud.normals.push_back(n.normalized().cast<float>());
  }
  return cloud;
}

Result<scan::ScanFile> read_faces(const std::filesystem::path& path) {
  const auto bytes = read_file(path, 1ULL << 32U);
  if (!bytes) return tl::unexpected{bytes.error()};
  scan::ReadOptions options;
  options.keep_faces = true;
  return scan::read_scan_file(*bytes, path.filename().string(), options, {});
}

MeshTruth mesh_of(const scan::ScanFile& file) {
  std::vector<Vec3> corners;
  for (const auto& p : file.cloud.points) corners.push_back(file.cloud.origin + p.cast<double>());
  return MeshTruth{corners, file.faces};
}

Result<MeshTruth> read_mesh(const std::filesystem::path& path, bool must_be_closed) {
  const auto file = read_faces(path);
  if (!file) return tl::unexpected{file.error()};
  MeshTruth mesh = mesh_of(*file);
  if (must_be_closed && !mesh.closed()) return fail(ErrorCode::InvalidInput, "no closed mesh");
  return mesh;
}

}  // namespace telefab::test
