// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/placing/room.hpp>

namespace telefab::scan {
namespace {

constexpr double kFitMargin = 0.01;  // of the room, kept free on every side

}  // namespace

Vec3 room_of(const MachineProfile& machine) {
  return {machine.platform.width_mm, machine.platform.depth_mm, machine.platform.z_travel_mm};
}

double fitted_scale(const MachineProfile& machine, const Vec3& size, const Vec3& beyond_mm) {
  // The surface swells beyond its samples, by a share of their spacing that is not known yet, and supports lift it.
  const Vec3 room = room_of(machine);
  const Vec3 used = (1 - 2 * kFitMargin) * room - Vec3{0, 0, machine.supports.lift_off_mm};
  return (used.cwiseMax(room / 2) - beyond_mm).cwiseQuotient(size).minCoeff();
}

}  // namespace telefab::scan
