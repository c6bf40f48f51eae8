// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <telefab/scan/cloud/box3.hpp>
#include <vector>

namespace telefab::scan {

/// What a point of a picture is. The first three are SurfaceClass; numbers go to pages: never renumber.
enum class PointKind : std::uint8_t { Measured = 1, Completed = 2, Doubtful = 3, LeftOut = 4 };

/// Points to be shown. Frame and unit of the file.
struct ShownPoints {
  Vec3 origin = Vec3::Zero();            ///< of the points
  std::vector<Eigen::Vector3f> points;   ///< relative to it
  std::vector<Eigen::Vector3f> normals;  ///< one a point, or none at all
  std::vector<PointKind> kinds;          ///< one a point, or none: all are measured
};

/// The order in which points are sent: each beginning of it is spread evenly over all of them (Morton order, read with
/// its bits reversed). At most so many, thinned evenly in the same way. Same points, same order.
[[nodiscard]] std::vector<std::uint32_t> progressive_order(std::span<const Eigen::Vector3f> points, std::size_t most);

/// Points in levels of detail: level 0 is a coarse picture, each further one adds points. Quantised to 16 bits along
/// the longest side. Immutable.
class CloudPicture {
 public:
  static constexpr std::size_t kMostPoints = 2'000'000;
  static constexpr std::size_t kFirstLevel = 50'000;  ///< points; each further level brings four times as many together
  static constexpr std::uint32_t kMagic = 0x50434654;  ///< "TFCP"
  static constexpr std::uint32_t kVersion = 1;
  static constexpr std::size_t kHeadBytes = 64;

  /// A picture of nothing.
  CloudPicture() = default;
  explicit CloudPicture(const ShownPoints& shown);

  [[nodiscard]] std::size_t size() const { return places_.size() / 4; }
  [[nodiscard]] std::uint32_t levels() const;
  /// Little-endian. Head: magic, version, level, levels, first point, points here, points in all, 1 where there are
  /// normals (8 x u32); where quantum 0 is (3 x f64) and the size of a quantum (f64), unit of the file. Then u16
  /// x, y, z, kind a point; then i8 x, y, z, 0 a point (127 = 1). `level` < levels().
  [[nodiscard]] std::vector<std::byte> level(std::uint32_t level) const;

 private:
  std::vector<std::uint16_t> places_;  ///< four a point
  std::vector<std::int8_t> normals_;   ///< four a point
  bool has_normals_ = false;
  Vec3 low_ = Vec3::Zero();
  double step_ = 1;
};

}  // namespace telefab::scan
