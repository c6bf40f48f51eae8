// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

enum class ScanFormat { Ply, Pcd, Text, Off, Stl, Obj, Ptx, E57, Las };

/// "PLY", "PCD", ...: for messages and reports.
[[nodiscard]] std::string_view name_of(ScanFormat format);

struct ReadOptions {
  std::size_t max_points = 400'000'000;  ///< >= 1; a file that claims more is refused (TooLarge)
  bool keep_faces = false;  ///< for the virtual digitizer, for points on faces and for judges: no mesh is ever sliced
  /// >= 1; of a file with twice as many points or more, so many stay at most, as even as they come, and each stands for
  /// those about it (decision 0411): memory is bounded by these, whatever max_points says. Files whose points are named
  /// by faces that are kept, or by a grid of a PLY file, or whose normals come behind all points, are taken whole.
  /// None: all files are.
  std::optional<std::size_t> most_points;
  std::function<void()> let_go;  ///< called now and then: what was read so far will not be looked at again soon
};

/// One range image: which cell of the scanner's grid saw which point of the cloud.
struct RangeView {
  static constexpr std::int32_t kEmpty = -1;
  std::uint32_t rows = 0;
  std::uint32_t columns = 0;
  std::vector<std::int32_t> point_at;  ///< rows * columns, row by row: index into the cloud's points or kEmpty
  std::optional<Vec3> scanner;         ///< where the scanner stood, frame and unit of the cloud; unset = not stated

  [[nodiscard]] std::int32_t at(std::uint32_t row, std::uint32_t column) const {
    return point_at[std::size_t{row} * columns + column];
  }
};

/// A scan file as it stands: points in file order, duplicates kept. Every point is finite; those that are NaN, or 0 0 0
/// in a grid of cells, are left out. A normal the file leaves out or gives as zero or NaN is the zero vector; normals
/// that are all the same are none.
struct ScanFile {
  ScanFormat format = ScanFormat::Text;
  PointCloud cloud;
  std::vector<RangeView> views;  ///< one a range image; empty for plain clouds
  std::vector<std::array<std::uint32_t, 3>>
      faces;                      ///< corners as indices of points; filled if asked for: PLY, OFF, STL, OBJ
  std::size_t empty_returns = 0;  ///< points the file marks as not seen (NaN, 0 0 0 in a grid), invalid (E57) or
                                  ///< withheld (LAS); left out
};

/// Reads PLY, PCD, PTX, E57, LAS, OFF, STL, OBJ or text (XYZ, PTS, PWN, CSV), told apart by content, then by the suffix
/// of `file_name`. Faces are skipped unless asked for. Memory is bounded by a small multiple of the bytes given. Fails:
/// InvalidInput (empty, truncated, wrong magic, no point, a decimal comma that cannot be told from a mark, coordinate
/// beyond 1e12; says line or point), TooLarge (more than max_points), Cancelled.
[[nodiscard]] Result<ScanFile> read_scan_file(std::span<const std::byte> bytes, std::string_view file_name,
                                              const ReadOptions& options, std::stop_token stop);

/// Refuses what is surely no scan, by the first kilobytes of a file: a picture, an archive, a CAD model. What passes
/// may still be damaged. Fails with InvalidInput: what it is, and what to do instead.
[[nodiscard]] Result<void> check_may_be_scan(std::span<const std::byte> beginning, std::string_view file_name);

/// read_scan_file made ready for work: duplicate positions become one point (first place, mean normal), and points
/// whose normal is missing are left out when they are under 1 %; else all normals are dropped, to be estimated.
[[nodiscard]] Result<PointCloud> read_cloud(std::span<const std::byte> bytes, std::string_view file_name,
                                            const ReadOptions& options, std::stop_token stop);

/// The cloud of a file made ready in the same way, with a note where its faces carry no points.
[[nodiscard]] PointCloud cloud_of(ScanFile file);

/// Merges points of equal position: the first keeps its place, normals are averaged, the higher confidence and the
/// wider sheets stay.
[[nodiscard]] PointCloud without_duplicates(PointCloud cloud);

}  // namespace telefab::scan
