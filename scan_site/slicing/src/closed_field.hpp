// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>

#include "completed_scan.hpp"

namespace telefab::scan {

/// A field that answers everywhere: where no sample is in the reach of its kernel, all samples together tell the side
/// (winding number above one half: solid). Its contours close.
class ClosedField final : public ScalarField {
 public:
  /// Where all samples together are asked.
  enum class Asked : std::uint8_t { OutOfReach = 1, Everywhere = 2 };
  /// Both outlive it.
  ClosedField(const ScalarField& near, const CompletedScan& scan, Asked asked = Asked::OutOfReach)
      : near_{near}, scan_{scan}, asked_{asked} {}
  [[nodiscard]] std::unique_ptr<FieldCursor> cursor() const override;
  [[nodiscard]] Box3 bounds() const override { return near_.bounds(); }
  [[nodiscard]] double kernel_width_mm(const Vec3& point_mm) const override { return near_.kernel_width_mm(point_mm); }

 private:
  const ScalarField& near_;
  const CompletedScan& scan_;
  Asked asked_;
};

}  // namespace telefab::scan
