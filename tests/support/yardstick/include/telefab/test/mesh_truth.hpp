// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <telefab/geometry/layer.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <vector>

namespace telefab::test {

using scan::Vec3;

/// Outer and hole rings of an exact section.
struct RingCount {
  int outers = 0;
  int holes = 0;
  friend bool operator==(const RingCount&, const RingCount&) = default;
};

/// A closed mesh as the truth about a scan made of it: sections, distances, samples.
class MeshTruth {
 public:
  /// Corners of equal position become one; faces of no extent go. `faces` index `corners`.
  MeshTruth(std::span<const Vec3> corners, std::span<const std::array<std::uint32_t, 3>> faces);
  ~MeshTruth();
  MeshTruth(MeshTruth&&) noexcept;

  /// Every edge lies in two faces, once in each direction.
  [[nodiscard]] bool closed() const;
  /// V - E + F.
  [[nodiscard]] int euler() const;
  [[nodiscard]] std::span<const Vec3> corners() const { return corners_; }
  /// The same mesh, every corner times the matrix.
  [[nodiscard]] MeshTruth moved(const Transform4& matrix) const;

  /// Rings of the section at z, but those whose area over a quarter of their length is below `least_width`; faces that
  /// point inward are taken as pointing outward.
  [[nodiscard]] RingCount rings(double z, double least_width = 0) const;
  /// The section at z as one segment a face, solid on the left; in no order.
  [[nodiscard]] std::vector<std::array<Point2, 2>> section(double z) const;
  /// Distance to the nearest face.
  [[nodiscard]] double distance(const Vec3& place) const;
  /// Corners with the mean normals of their faces.
  [[nodiscard]] scan::PointCloud as_scanned() const;
  /// As many points evenly at random over the faces, with the corners' normals blended, moved by Gaussian noise.
  [[nodiscard]] scan::PointCloud sampled(std::size_t count, double noise, double normal_noise,
                                         std::uint64_t seed) const;
  [[nodiscard]] double area() const;

 private:
  struct Nearest;
  [[nodiscard]] std::vector<Vec3> corner_normals() const;

  std::vector<Vec3> corners_;
  std::vector<std::array<std::uint32_t, 3>> faces_;
  double outward_ = 1;
  mutable std::unique_ptr<Nearest> nearest_;
};

/// The file with its faces, if it has any. Fails as readers do.
[[nodiscard]] Result<scan::ScanFile> read_faces(const std::filesystem::path& path);
/// Of a file with faces.
[[nodiscard]] MeshTruth mesh_of(const scan::ScanFile& file);
/// A mesh file. Fails as readers do, and with InvalidInput where it must be closed and is not.
[[nodiscard]] Result<MeshTruth> read_mesh(const std::filesystem::path& path, bool must_be_closed = true);

}  // namespace telefab::test
