// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <string>
#include <telefab/scan/formats/read_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// A scanner whose grid is, nearly, a parallel projection: row and column are affine in the point.
struct ParallelProjection {
  Eigen::Vector4d row = Eigen::Vector4d::Zero();     ///< row = (p, 1) . row
  Eigen::Vector4d column = Eigen::Vector4d::Zero();  ///< column = (p, 1) . column
  Vec3 towards_scanner = Vec3::UnitZ();              ///< unit; moving along it changes neither row nor column
  double residual_px = 0;                            ///< rms of what the fit leaves
};

/// One range image made ready for registration. Frame and unit of its file; coordinates are absolute (no origin).
struct RangeImage {
  std::string name;
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;  ///< unit, towards the scanner (see make_range_image)
  std::vector<float> weight;             ///< [0, 1]: cosine of incidence, 0 at depth edges and the rim of the image
  RangeView view;                        ///< cells index `points`
  std::optional<ParallelProjection> projection;  ///< unset where no parallel projection fits within 1.5 px
  float spacing = 0;                             ///< median distance of neighbouring cells, unit of the file
};

/// Normals from the grid itself: cross product of the differences to neighbouring cells that no depth edge parts,
/// smoothed over the 3x3 cells about. They face the scanner if the file says where it stood; if not, all images of one
/// scanner have the same, perhaps wrong, sense, which register_views finds out. Points without such neighbours are
/// dropped. Fails: InvalidInput (no grid, fewer than 100 usable points).
[[nodiscard]] Result<RangeImage> make_range_image(const ScanFile& file, std::size_t view, std::string name);

/// Points of which no grid is known, as an image without cells: it matches others but sees through nothing. The normals
/// are the cloud's. Fails: InvalidInput (no normals, fewer than 100 points).
[[nodiscard]] Result<RangeImage> make_gridless_image(const PointCloud& cloud, std::string name);

/// Takes points out; their cells become empty. `keep`: one a point.
void keep_points(RangeImage& image, const std::vector<bool>& keep);

/// Turns the normals and the scanner's direction round: for images whose grid runs the other way about.
void face_away(RangeImage& image);

}  // namespace telefab::scan
