// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

struct SurfaceGraph;

/// Boxes here are in the frame and unit of the cloud, origin included.
/// "x0,y0,z0,x1,y1,z1", any two opposite corners. Fails: InvalidInput.
[[nodiscard]] Result<Box3> crop_box_from(std::string_view text);
/// "all" (0), "largest" (1) or how many of the largest. Fails: InvalidInput.
[[nodiscard]] Result<std::uint32_t> pieces_from(std::string_view text);

/// "only:2,5": the numbers, rising, each once. Fails: InvalidInput.
[[nodiscard]] Result<std::vector<std::uint32_t>> piece_numbers_from(std::string_view text);
/// What they begin with.
inline constexpr std::string_view kOnlyPieces = "only:";

/// A box in a frame of its own.
struct FramedBox {
  Eigen::Matrix<double, 3, 4> to_frame;  ///< takes places of the cloud there
  Box3 box;                              ///< in that frame
  [[nodiscard]] bool contains(const Vec3& place) const;
};

/// What of a cloud is the object.
struct PickOptions {
  std::optional<Box3> crop;  ///< points outside are left out first of all
  std::uint32_t pieces = 0;  ///< so many of the largest pieces stay, and the ground they stand on goes; 0: all
  /// The pieces of these numbers stay, rising from 1, the largest; the others and the ground go. Empty: `pieces` says.
  std::vector<std::uint32_t> only = {};
  bool keep_outliers = false;  ///< strays stay
  /// What lies outside was found to be off the surface by whoever made one of the points; strays too.
  std::optional<FramedBox> surface_box = std::nullopt;
};

/// Points that links between neighbours join.
struct Piece {
  std::size_t points = 0;
  Box3 box;
  bool kept = true;
};

/// A plane with nothing behind it that reaches out beyond all that stands on it.
struct StandingGround {
  double share = 0;  ///< of the points
  Vec3 up = Vec3::UnitZ();
  bool left_out = false;
};

struct PickReport {
  std::size_t points_in = 0;
  std::size_t cropped = 0;          ///< points outside the box asked for
  std::size_t strays = 0;           ///< points on no surface: alone, in clumps too small for one, or scattered in space
  std::size_t in_other_pieces = 0;  ///< points of pieces not asked for, and of the ground
  std::vector<Piece> pieces;        ///< largest first; strays are none
  std::optional<StandingGround> ground;
  bool is_scene = false;  ///< many pieces, none of which is most of it
  Box3 before;            ///< of the points within the crop
  Box3 after;             ///< of the points that are left
};

struct PickResult {
  PointCloud cloud;
  PickReport report;
  std::shared_ptr<SurfaceGraph> graph;  ///< of `cloud`; with_normals takes it over instead of building its own
};

/// Decides what belongs to the object before its size means anything: crop, strays, pieces, ground. A stray is linked
/// to nothing within about five spacings; nearer ones are the surface's to tell. Order and values of the points that
/// stay are as they were. Fails: InvalidInput (too few points, all on one line or plane or in one place, nothing within
/// the crop, no such pieces), Cancelled. Same bytes on any number of threads. Cost: that of the 16 nearest neighbours
/// of every point, which with_normals needs too.
[[nodiscard]] Result<PickResult> pick_object(PointCloud cloud, const PickOptions& options, std::stop_token stop);

/// What was left out and what the scan looks like, for people; nothing for one clean piece.
[[nodiscard]] std::vector<std::string> sentences_of(const PickReport& report);
/// One JSON object, fixed key order.
[[nodiscard]] std::string to_json(const PickReport& report);

}  // namespace telefab::scan
