// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/section/plane_cursor.hpp>

namespace telefab::scan {

std::optional<Vec2> first_order_crossing(const Vec3& point_mm, const Vec3& normal, double z_mm, double most_shift_mm,
                                         double least_across) {
  const Vec2 across = normal.head<2>();
  const double across2 = across.squaredNorm();
  if (across2 < least_across * least_across) return std::nullopt;
  const Vec2 shift = -(z_mm - point_mm.z()) * normal.z() / across2 * across;
  if (shift.norm() > most_shift_mm) return std::nullopt;
  return point_mm.head<2>() + shift;
}

}  // namespace telefab::scan
