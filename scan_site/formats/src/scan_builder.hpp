// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <telefab/scan/formats/read_cloud.hpp>
#include <vector>

#include "coarse_steps.hpp"
#include "thinning.hpp"

namespace telefab::scan {

/// Where the readers put what they read. Claims of a header are checked against the bytes present before memory is
/// taken; what a file may hold is checked in finish(), once for all formats.
class ScanBuilder {
 public:
  ScanBuilder(ScanFormat format, const ReadOptions& options);

  /// Reserves room for `count` points, each of which takes at least `bytes_each` of the `bytes_left`.
  /// Fails: InvalidInput (the file is shorter than it claims), TooLarge.
  [[nodiscard]] Result<void> expect(std::uint64_t count, std::uint64_t bytes_left, std::uint64_t bytes_each);

  /// A point that is NaN is left out in finish(), with its normal, its place in views and its faces.
  void add(const Vec3& point) {
    if (points_.size() >= full_at_) thin();
    points_.push_back(point);
  }
  void add_normal(const Vec3& normal) { normals_.push_back(normal.cast<float>()); }
  void add_confidence(float value) { confidence_.push_back(value); }
  void add_sheets_apart(float value) { sheets_apart_.push_back(value); }
  void add_view(RangeView view) { views_.push_back(std::move(view)); }
  /// One polygon by its corners, kept as a fan of triangles if faces are wanted.
  void add_face(std::span<const std::uint64_t> corners);
  [[nodiscard]] bool keeps_faces() const { return options_.keep_faces; }
  /// Says what unit the format asks for, millimetres.
  void state_unit(double millimetres) { unit_mm_ = millimetres; }
  void add_empty_return() { ++empty_returns_; }
  /// The points stand in a grid of cells: 0 0 0 is a cell that saw nothing.
  void zeros_are_no_return() { zeros_are_no_return_ = true; }
  /// The points are corners of faces; any of them may be 0 0 0.
  void points_are_corners() {
    points_are_corners_ = true;
    if (keeps_faces()) points_are_named();
  }
  /// Something names points by their number: all of them stay. Before the first point.
  void points_are_named();
  void note(ScanRemark remark, std::string text) { notes_.push_back({remark, std::move(text)}); }
  [[nodiscard]] std::size_t size() const { return points_.size(); }

  /// Drops the normals: the file turned out to have none that can be told to belong to the points.
  void forget_normals() { normals_.clear(); }

  /// Fails: InvalidInput (no point, a point that is infinite or beyond 1e12, a face that names no point).
  [[nodiscard]] Result<ScanFile> finish() &&;

 private:
  /// What was read so far, without what is not seen, becomes fewer points.
  void thin();
  void set_unseen_aside();
  [[nodiscard]] Result<void> finish_thinning();
  [[nodiscard]] PointLists lists() { return {points_, normals_, confidence_, sheets_apart_}; }
  void note_unseen(std::size_t nans, std::size_t zeros, std::size_t all);
  void leave_out_unseen();
  [[nodiscard]] bool has_zero_heap() const;
  [[nodiscard]] std::vector<Eigen::Vector3f> unit_normals(std::span<const Eigen::Vector3f> points);

  ScanFormat format_;
  ReadOptions options_;
  std::vector<Vec3> points_;
  std::vector<Eigen::Vector3f> normals_;
  std::vector<float> confidence_;
  std::vector<float> sheets_apart_;
  std::vector<RangeView> views_;
  std::vector<std::array<std::uint32_t, 3>> faces_;
  std::size_t empty_returns_ = 0;
  std::optional<double> unit_mm_;
  bool zeros_are_no_return_ = false;
  bool points_are_corners_ = false;
  std::vector<ScanNote> notes_;

  /// What was left out of a stream that is thinned, where finish() would look for it.
  struct SetAside {
    std::uint64_t points = 0;  ///< read, these included
    std::uint64_t nans = 0, zeros = 0;
    Eigen::Vector3f zero_normal = Eigen::Vector3f::Zero();  ///< of the first at 0 0 0
    std::optional<std::pair<std::uint64_t, Vec3>> beyond;   ///< the first that is too far, and its number
  };
  std::size_t full_at_;  ///< so many points are thinned
  std::optional<Thinning> thinning_;
  SetAside aside_;
  std::optional<CoarseSteps> coarse_;  ///< of the coordinates as they were read
};

}  // namespace telefab::scan
