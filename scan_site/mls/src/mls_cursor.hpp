// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <memory>
#include <span>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

#include "kernel.hpp"
#include "sample_grid.hpp"

namespace telefab::scan {

/// Local scale of the field on a coarse grid: a pure function of the place.
class ScaleTable {
 public:
  /// One width everywhere.
  explicit ScaleTable(double width_mm) : reference_mm_{width_mm} {}
  ScaleTable(std::span<const SampleGrid> bands, const Vec3& origin, double reference_mm);

  [[nodiscard]] double reference_mm() const { return reference_mm_; }
  /// Mean width of the samples about the place; the reference where there are none.
  [[nodiscard]] double width_mm(const Vec3& point_mm) const;
  /// Side of the gather lattice there: reference * 2^level.
  [[nodiscard]] int level(const Vec3& point_mm) const;

 private:
  [[nodiscard]] std::size_t cell_of(const Vec3& point_mm) const;
  double reference_mm_;
  double cell_mm_ = 0;  ///< 0: no table
  Vec3 low_ = Vec3::Zero();
  Eigen::Array3i count_ = Eigen::Array3i::Zero();
  std::vector<float> width_;
  std::vector<std::int8_t> level_;
};

/// What cursors read; shared and immutable.
struct FieldParts {
  Vec3 origin = Vec3::Zero();  ///< of every band's grid
  /// Samples whose widths differ by less than a factor of about two, each in a grid that fits them.
  std::vector<SampleGrid> bands;
  std::size_t gap_bands = 0;  ///< the last ones: samples that nobody measured
  ScaleTable scale{1};
  KernelForm form = KernelForm::Unbiased;
  KernelSet kernels{};
  std::size_t slots = 64;  ///< gathered cells a cursor remembers; a power of two
};

/// Gathers the neighbours of a lattice cell once and evaluates from the copy while queries stay in cells it
/// remembers. What it remembers changes speed only.
class MlsCursor final : public FieldCursor {
 public:
  explicit MlsCursor(const FieldParts& parts);
  [[nodiscard]] FieldSample at(const Vec3& point_mm) override;
  /// What the kernel says, in reference widths.
  [[nodiscard]] KernelOutput raw(const Vec3& point_mm);

 private:
  struct Gathered {
    std::array<std::int32_t, 4> key{};  ///< lattice cell and level
    bool filled = false;
    std::size_t count = 0;     ///< padded
    std::size_t capacity = 0;  ///< of one array
    Vec3 centre_mm = Vec3::Zero();
    struct Free {
      void operator()(float* p) const;
    };
    std::unique_ptr<float[], Free> floats;  ///< seven arrays
    void reserve(std::size_t wanted);
  };
  Gathered& gathered_at(const Vec3& point_mm);
  void gather(Gathered& to);

  const FieldParts& parts_;
  std::vector<Gathered> slots_;
  Gathered work_;       ///< theta
  Gathered gathering_;  ///< before it is known how many they are
  std::vector<SampleRun> runs_;
};

}  // namespace telefab::scan
