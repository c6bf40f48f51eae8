// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <telefab/scan/cloud/box3.hpp>
#include <vector>

namespace telefab::scan {

/// What reading a scan found out that whoever made it should hear.
enum class ScanRemark : std::uint8_t {
  PointsLeftOut,      ///< NaN, or a mark of no return
  NotNormals,         ///< what looked like normals, or was named so, is none
  DecimalComma,       ///< numbers were written 12,34 and are read as 12.34
  GuessedColumns,     ///< which column is what was told by the numbers alone
  SeveralScans,       ///< the file holds more than one
  CoarseCoordinates,  ///< positions are rounded to steps that are coarse against the spacing of the points
  EmptyFaces,         ///< the file is a mesh whose faces carry no points
  Thinned             ///< the file holds more points than are taken
};
struct ScanNote {
  ScanRemark remark;
  std::string text;  ///< one sentence, for people
};

/// Points of a scan, in the scanner's frame and the file's unit until scaled to millimetres by placement.
/// Positions are float relative to `origin`, so that 24 bytes a point hold a scan anywhere on Earth.
/// Invariant kept by the readers: all finite; normals is empty or has one unit vector a point, outward;
/// confidence is empty or has one value in [0, 1] a point; so has sheets_apart, with values of 0 or more.
struct PointCloud {
  Vec3 origin = Vec3::Zero();
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> confidence;
  /// How far apart the two sheets are in which the views of the scan show the surface here; 0: there is one. Unit of
  /// the positions.
  std::vector<float> sheets_apart;
  std::optional<double> unit_mm;  ///< millimetres in one unit of the positions, where the file or somebody states it
  double rounding =
      0;  ///< step the positions were rounded to, where it is coarse against their spacing; unit of the positions
  std::vector<ScanNote> notes;  ///< of the reader; lost where points are picked or merged

  [[nodiscard]] std::size_t size() const { return points.size(); }
  [[nodiscard]] bool has_normals() const { return !normals.empty(); }

  /// Point `from` with all that belongs to it also stands at `to`; and the first `count` points stay. Both together
  /// leave points out in place.
  void copy_point(std::size_t from, std::size_t to) {
    points[to] = points[from];
    if (has_normals()) normals[to] = normals[from];
    if (!confidence.empty()) confidence[to] = confidence[from];
    if (!sheets_apart.empty()) sheets_apart[to] = sheets_apart[from];
  }
  void shrink(std::size_t count) {
    points.resize(count);
    if (has_normals()) normals.resize(count);
    if (!confidence.empty()) confidence.resize(count);
    if (!sheets_apart.empty()) sheets_apart.resize(count);
  }
};

}  // namespace telefab::scan
