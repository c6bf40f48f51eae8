// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/scan/cloud/box3.hpp>

namespace telefab::scan {

/// Value and gradient of an implicit surface at a point. Build frame, millimetres.
struct FieldSample {
  double value_mm = 0;           ///< about the signed distance; negative inside
  Vec3 gradient = Vec3::Zero();  ///< of value_mm; about the outward unit normal near the surface
  bool in_reach = false;         ///< false: too few samples near, value and gradient mean nothing
  double closeness_mm = 0;       ///< plain weighted plane distance (IMLS), for the paper's closeness pick (3.3)
};

/// Evaluates one field from one thread; keeps what neighbouring evaluations share. Not for two threads at once.
class FieldCursor {
 public:
  virtual ~FieldCursor() = default;
  FieldCursor(const FieldCursor&) = delete;
  FieldCursor& operator=(const FieldCursor&) = delete;
  [[nodiscard]] virtual FieldSample at(const Vec3& point_mm) = 0;

 protected:
  FieldCursor() = default;
};

/// An implicit surface whose zero set is cut into layers: the moving-least-squares field of a scan, or a formula in
/// a test. Immutable; const methods may be called from several threads.
class ScalarField {
 public:
  virtual ~ScalarField() = default;
  ScalarField(const ScalarField&) = delete;
  ScalarField& operator=(const ScalarField&) = delete;

  [[nodiscard]] virtual std::unique_ptr<FieldCursor> cursor() const = 0;
  /// Holds the whole zero set.
  [[nodiscard]] virtual Box3 bounds() const = 0;
  /// Width h of the kernel near a point: the smallest detail the field can hold, the scale of every step.
  [[nodiscard]] virtual double kernel_width_mm(const Vec3& point_mm) const = 0;

 protected:
  ScalarField() = default;
};

}  // namespace telefab::scan
