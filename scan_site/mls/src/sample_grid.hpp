// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "kernel.hpp"

namespace telefab::scan {

/// One sample, relative to the origin of its grid, millimetres.
struct GridSample {
  Eigen::Vector3f place;
  Eigen::Vector3f normal;
  float width;  ///< kernel width h of this sample
};

/// Floats as integers of the same order.
[[nodiscard]] inline std::uint32_t rising(float v) {
  const auto bits = std::bit_cast<std::uint32_t>(v);
  return (bits & 0x80000000U) != 0 ? ~bits : bits | 0x80000000U;
}

/// Samples sorted into cubic cells: slabs along z, rows along y in them, cells along x in those; only occupied cells
/// take memory beyond a bit. Within a cell the coordinates give the order, so that the file's order of points decides
/// nothing. Stored in blocks of eight, x, y, z apart. 24 bytes a sample, 28 with a width each.
class SampleGrid {
 public:
  struct alignas(32) Block {
    float x[8], y[8], z[8];
  };
  struct alignas(32) Widths {
    float width[8];
  };

  SampleGrid() = default;
  /// `widths_mm` has one a sample, or none: width 1 for all. `cell_mm` > 0 is enlarged where cells would outnumber
  /// samples by far. Takes 16 bytes a sample beside what it is given, and gives that back as it goes.
  SampleGrid(std::vector<Eigen::Vector3f> points, std::vector<Eigen::Vector3f> normals,
             std::span<const float> widths_mm, double cell_mm);
  /// The same samples, all of width 1, in other cells.
  [[nodiscard]] SampleGrid with_cells(double cell_mm) &&;

  [[nodiscard]] std::uint32_t size() const { return count_; }
  [[nodiscard]] Eigen::Vector3f place(std::size_t i) const {
    const Block& b = places_[i / 8];
    return {b.x[i % 8], b.y[i % 8], b.z[i % 8]};
  }
  [[nodiscard]] Eigen::Vector3f normal(std::size_t i) const {
    const Block& b = normals_[i / 8];
    return {b.x[i % 8], b.y[i % 8], b.z[i % 8]};
  }
  [[nodiscard]] float width(std::size_t i) const { return widths_.empty() ? width_mm_ : widths_[i / 8].width[i % 8]; }
  [[nodiscard]] GridSample sample(std::size_t i) const { return {place(i), normal(i), width(i)}; }
  [[nodiscard]] float widest_mm() const { return widest_mm_; }
  [[nodiscard]] double cell_mm() const { return cell_; }

  void set_width(float width_mm);
  /// One a sample, in the grid's order.
  void set_widths(std::span<const float> widths_mm);
  void scale_widths(float factor);
  /// Leaves out the samples whose flag is 0.
  void keep(std::span<const std::uint8_t> flags);

  /// Where the arrays stand; the centre, margin and scale are left to the caller.
  [[nodiscard]] GatherInput arrays() const;

  /// Calls take(first, last) for runs that hold every sample within radius of the centre, and some farther ones.
  template <class Take>
  void visit(const Eigen::Vector3f& centre, float radius, Take&& take) const {
    if (count_ == 0) return;
    const auto [y0, y1] = range(centre.y(), radius, low_.y(), ny_);
    const auto [z0, z1] = range(centre.z(), radius, low_.z(), nz_);
    for (int k = z0; k <= z1; ++k) {
      const float dz = outside(centre.z(), low_.z() + static_cast<float>(k) * cell_);
      for (int j = y0; j <= y1; ++j) {
        const float dy = outside(centre.y(), low_.y() + static_cast<float>(j) * cell_);
        const float left = radius * radius - dy * dy - dz * dz;
        if (left < 0) continue;
        const auto [x0, x1] = range(centre.x(), std::sqrt(left), low_.x(), nx_);
        const std::size_t row = (static_cast<std::size_t>(k) * ny_ + j) * words_;
        const std::uint32_t from = cells_before(row, x0);
        const std::uint32_t to = cells_before(row, x1 + 1);
        if (from != to) take(cell_first_[from], cell_first_[to]);
      }
    }
  }
  /// Calls take(first, last) for the runs that hold every sample with low <= z <= high (relative to the origin), and
  /// some others.
  template <class Take>
  void visit_slabs(float low, float high, Take&& take) const {
    if (count_ == 0 || !(low <= high)) return;
    const int z0 = std::clamp(index(low, low_.z(), nz_), 0, nz_ - 1);
    const int z1 = std::clamp(index(high, low_.z(), nz_), 0, nz_ - 1);
    const std::size_t row = static_cast<std::size_t>(ny_) * words_;
    const std::uint32_t from = before_[z0 * row];
    const std::uint32_t to = before_[(z1 + 1) * row];
    if (from != to) take(cell_first_[from], cell_first_[to]);
  }

 private:
  struct Range {
    int first, last;
  };
  [[nodiscard]] int index(float at, float low, int count) const {
    const float cell = (at - low) * inverse_cell_;
    return cell <= 0 ? 0 : cell >= static_cast<float>(count) ? count - 1 : static_cast<int>(cell);
  }
  [[nodiscard]] Range range(float centre, float radius, float low, int count) const {
    return {index(centre - radius, low, count), index(centre + radius, low, count)};
  }
  [[nodiscard]] float outside(float at, float low) const {
    return at < low ? low - at : at > low + cell_ ? at - low - cell_ : 0.F;
  }
  /// Occupied cells before cell x of the row whose first word is given.
  [[nodiscard]] std::uint32_t cells_before(std::size_t row, int x) const {
    const std::size_t word = row + static_cast<std::size_t>(x) / 64;
    const std::uint64_t bits = bits_[word] & ((std::uint64_t{1} << (x % 64)) - 1);
    return before_[word] + (bits == 0 ? 0 : bit_count(bits));
  }
  /// std::popcount is a call on machines without the instruction; this is not.
  static std::uint32_t bit_count(std::uint64_t v) {
    v -= v >> 1U & 0x5555555555555555U;
    v = (v & 0x3333333333333333U) + (v >> 2U & 0x3333333333333333U);
    v = (v + (v >> 4U)) & 0x0f0f0f0f0f0f0f0fU;
    return static_cast<std::uint32_t>(v * 0x0101010101010101U >> 56U);
  }
  void choose_cells(std::span<const Eigen::Vector3f> points, double cell_mm);
  [[nodiscard]] std::size_t row_of(const Eigen::Vector3f& p) const {
    return static_cast<std::size_t>(index(p.z(), low_.z(), nz_)) * ny_ + index(p.y(), low_.y(), ny_);
  }
  void widen();

  std::uint32_t count_ = 0;
  Eigen::Vector3f low_ = Eigen::Vector3f::Zero();
  float cell_ = 1;
  float inverse_cell_ = 1;
  int nx_ = 1;
  int ny_ = 1;
  int nz_ = 1;
  std::size_t words_ = 1;  ///< of a row
  std::vector<Block> places_;
  std::vector<Block> normals_;
  std::vector<Widths> widths_;  ///< empty: width_mm_ for all
  float width_mm_ = 1;
  float widest_mm_ = 1;
  std::vector<std::uint64_t> bits_;        ///< a bit a cell: occupied; one word more than rows have
  std::vector<std::uint32_t> before_;      ///< occupied cells before a word; likewise
  std::vector<std::uint32_t> cell_first_;  ///< sample of an occupied cell; one more than there are
};

}  // namespace telefab::scan
