// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/placement.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/placing/room.hpp>

namespace telefab::scan {

namespace {

/// The scan's frame before it is scaled as a whole and moved.
struct Frame {
  Eigen::Matrix3d places;   ///< of places and directions between them
  Eigen::Matrix3d normals;  ///< they stay square to the surface and outward, mirrored or not

  Frame(const PlacementOptions& options, const Vec3& axis_scale) {
    Vec3 signs = Vec3::Ones();
    if (options.mirror) signs[static_cast<Eigen::Index>(*options.mirror) - 1] = -1;
    const Eigen::Matrix3d turned = options.turn.matrix() * signs.asDiagonal();
    places = axis_scale.asDiagonal() * turned;
    normals = axis_scale.cwiseInverse().asDiagonal() * turned;
    // Negative zeros would stand in reports.
    places.array() += 0.0;
  }
  [[nodiscard]] bool is_none() const { return places == Eigen::Matrix3d::Identity(); }
};

/// The scale decides how far a sheet's back reaches beyond its front, and that decides the scale: settled in so many
/// steps.
constexpr int kSheetSteps = 4;

/// The box of the turned scan in its own unit, with the back that a sheet of this thickness has behind it. Normals are
/// turned already.
Box3 box_of(const PointCloud& scan, const Frame& frame, double thickness) {
  Box3 box = Box3::nothing();
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Vec3 front = frame.places * scan.points[i].cast<double>();
    box.include(front);
    if (thickness > 0) box.include(Vec3{front - thickness * scan.normals[i].cast<double>()});
  }
  return box;
}

/// Where the middle of a part may stand that is so large, along one side of a platform.
std::string room_for(double size_mm, double platform_mm) {
  return fmt::format("{:.2f} to {:.2f}", std::ceil(size_mm * 50) / 100,
                     std::floor((platform_mm - size_mm / 2) * 100) / 100);
}

/// Fails where the part's box leaves the platform, by more than rounding.
Result<void> check_position(Point2 position, const Vec3& size_mm, const MachineProfile& machine) {
  const double width = machine.platform.width_mm, depth = machine.platform.depth_mm;
  const double slack = 1e-9 * std::max(width, depth);
  const auto leaves = [&](double at, double size, double side) {
    return at < size / 2 - slack || at > side - size / 2 + slack;
  };
  if (!leaves(position.x_mm, size_mm.x(), width) && !leaves(position.y_mm, size_mm.y(), depth)) return {};
  return fail(
      ErrorCode::InvalidInput,
      fmt::format("the part, {:.2f} x {:.2f} mm, leaves the platform of {} ({:g} x {:g} mm) where its middle is "
                  "at {:g},{:g}; there is room for x from {} and y from {}",
                  size_mm.x(), size_mm.y(), machine.name, width, depth, position.x_mm, position.y_mm,
                  room_for(size_mm.x(), width), room_for(size_mm.y(), depth)));
}

}  // namespace

Result<Placement> place_on_platform(PointCloud scan, const SliceRequest& request) {
  if (scan.points.empty()) return fail(ErrorCode::InvalidInput, "the scan has no points");
  const Vec3 axis_scale = request.drawn_axis_scale();
  const Frame frame{request.placement, axis_scale};
  if (!frame.is_none())
    for (auto& n : scan.normals) n = (frame.normals * n.cast<double>()).normalized().cast<float>();
  const Vec3 origin = frame.places * scan.origin;
  if (request.thickness_mm && scan.normals.size() != scan.size())
    return fail(ErrorCode::InvalidInput, "a sheet needs normals, to know which side is its back");
  Box3 box = box_of(scan, frame, 0);
  Vec3 min = origin + box.min;
  Vec3 size = box.size();
  if (!min.allFinite() || !size.allFinite())
    return fail(ErrorCode::InvalidInput, "the scan has coordinates that are not finite");
  const Vec3 room = room_of(request.machine);
  const double unit_mm = request.placement.unit_mm.value_or(scan.unit_mm.value_or(1));
  const auto scale_for = [&](const Vec3& beyond_mm) -> double {
    if (request.placement.height_mm) return (*request.placement.height_mm * axis_scale.z() - beyond_mm.z()) / size.z();
    if (request.placement.scale) return *request.placement.scale;
    if (!request.placement.fit) return unit_mm;
    return fitted_scale(request.machine, size, beyond_mm);
  };
  double scale = scale_for(Vec3::Zero());
  if (request.thickness_mm) {
    const Vec3 front = size;
    for (int step = 0; step < kSheetSteps && scale > 0 && std::isfinite(scale); ++step) {
      const Vec3 beyond_mm = scale * (box_of(scan, frame, *request.thickness_mm / scale).size() - front);
      scale = scale_for(beyond_mm);
    }
    if (!(scale > 0) || !std::isfinite(scale))
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("a sheet {:.4g} mm thick leaves no room for what was scanned; make it thinner, or the part "
                      "larger",
                      *request.thickness_mm));
    box = box_of(scan, frame, *request.thickness_mm / scale);
    min = origin + box.min;
    size = box.size();
  }
  if (!(size.z() > 0) || !(size.x() > 0) || !(size.y() > 0))
    return fail(ErrorCode::InvalidInput,
                fmt::format("the scan is flat: its box is {} x {} x {} units{}", size.x(), size.y(), size.z(),
                            scan.rounding > 0 ? fmt::format("; its coordinates are rounded to {:g}", scan.rounding)
                                              : std::string{}));
  const Vec3 size_mm = scale * size;
  std::optional<std::string> warning;
  if (!request.placement.height_mm && !request.placement.scale && !request.placement.fit)
    warning = scale_warning(size_mm, unit_mm);
  const double largest = room.cwiseQuotient(size).minCoeff();
  const std::string hint = warning ? "; " + *warning : std::string{};
  if (!size_mm.allFinite() || (size_mm - room).maxCoeff() > 1e-9 * room.maxCoeff())
    return fail(ErrorCode::InvalidInput,
                fmt::format("the part is {:.4g} x {:.4g} x {:.4g} mm, larger than {}: {:.4g} x {:.4g} mm platform, "
                            "{:.4g} mm travel; give --height-mm {:.4g} or less, or --fit{}",
                            size_mm.x(), size_mm.y(), size_mm.z(), request.machine.name, room.x(), room.y(), room.z(),
                            std::floor(largest * size.z() / axis_scale.z() * 100) / 100, hint));
  if (size_mm.minCoeff() < 1e-6)
    return fail(ErrorCode::InvalidInput, fmt::format("the part is {:.3g} x {:.3g} x {:.3g} mm, too small to be cut; "
                                                     "give --height-mm or --scale{}",
                                                     size_mm.x(), size_mm.y(), size_mm.z(), hint));

  const Point2 position = request.placement.position_mm.value_or(Point2{room.x() / 2, room.y() / 2});
  if (auto ok = check_position(position, size_mm, request.machine); !ok) return tl::unexpected{ok.error()};
  const Vec3 middle = min + size / 2;
  const Vec3 shift{position.x_mm - scale * middle.x(), position.y_mm - scale * middle.y(), -scale * min.z()};
  Placement placed;
  placed.options = request.placement;
  placed.options.axis_scale = axis_scale;
  placed.size_mm = size_mm;
  placed.scale_warning = std::move(warning);
  placed.unit_is_stated = request.placement.unit_mm || scan.unit_mm;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) placed.scan_to_build[static_cast<std::size_t>(4 * r + c)] = scale * frame.places(r, c);
    placed.scan_to_build[static_cast<std::size_t>(4 * r + 3)] = shift[r];
  }
  placed.scan_to_build[15] = 1;
  // Relative to the middle of the part: float keeps 10 nm there, wherever the scanner stood.
  placed.middle_mm = {position.x_mm, position.y_mm, size_mm.z() / 2};
  for (auto& p : scan.points)
    p = (scale * (origin + frame.places * p.cast<double>()) + shift - placed.middle_mm).cast<float>();
  for (float& apart : scan.sheets_apart) apart *= static_cast<float>(scale);
  placed.cloud = std::move(scan);
  placed.cloud.origin = placed.middle_mm;
  placed.cloud.unit_mm = 1;
  placed.cloud.rounding *= scale;
  return placed;
}

}  // namespace telefab::scan
