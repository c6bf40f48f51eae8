// SPDX-License-Identifier: GPL-3.0-or-later
#include "closed_field.hpp"

namespace telefab::scan {
namespace {

class ClosedCursor final : public FieldCursor {
 public:
  /// `near` may be none: then all samples together are asked everywhere.
  ClosedCursor(std::unique_ptr<FieldCursor> near, const CompletedScan& scan) : near_{std::move(near)}, scan_{scan} {}

  [[nodiscard]] FieldSample at(const Vec3& point_mm) override {
    FieldSample sample = near_ ? near_->at(point_mm) : FieldSample{};
    if (sample.in_reach) return sample;
    const double step = 0.1 * std::max(scan_.side_of(point_mm).distance_mm, 1e-3);
    sample.value_mm = value(point_mm);
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const Vec3 way = step * Vec3::Unit(axis);
      sample.gradient[axis] = (value(point_mm + way) - value(point_mm - way)) / (2 * step);
    }
    sample.closeness_mm = 0;
    sample.in_reach = true;
    return sample;
  }

 private:
  [[nodiscard]] double value(const Vec3& point_mm) const {
    const CompletedScan::Side side = scan_.side_of(point_mm);
    return 2 * side.distance_mm * (0.5 - side.winding);
  }

  std::unique_ptr<FieldCursor> near_;
  const CompletedScan& scan_;
};

}  // namespace

std::unique_ptr<FieldCursor> ClosedField::cursor() const {
  return std::make_unique<ClosedCursor>(asked_ == Asked::OutOfReach ? near_.cursor() : nullptr, scan_);
}

}  // namespace telefab::scan
