// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::test {

using scan::Vec3;

/// Where a shape stands: build_point = rotation * shape_point + shift_mm.
struct Pose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vec3 shift_mm = Vec3::Zero();

  /// Turned by `degrees` about an axis (any length but zero), then shifted.
  [[nodiscard]] static Pose turned(double degrees, const Vec3& axis, const Vec3& shift_mm = Vec3::Zero());
};

/// What is known of a shape without looking at any field. Heights are along build z, millimetres.
struct ShapeFacts {
  std::string name;
  std::optional<int> euler;       ///< of the whole surface
  std::vector<int> genus;         ///< one a component, sorted; empty where unknown
  std::vector<double> minima_mm;  ///< heights of the critical points, sorted; all three empty where unknown
  std::vector<double> saddles_mm;
  std::vector<double> maxima_mm;
};

/// A surface given by a formula, as a ScalarField: exact value and gradient of F/|grad F|, the distance to first
/// order, whose zero set is exactly that of F. As with a scan, the field is out of reach farther than 3 h away.
class AnalyticField : public scan::ScalarField {
 public:
  [[nodiscard]] virtual const ShapeFacts& facts() const = 0;
  /// The exact judgement, at any distance: is the point in the solid?
  [[nodiscard]] virtual bool inside(const Vec3& point_mm) const = 0;
  /// The formula itself: negative inside, continuous, any scale. For marching squares of a test.
  [[nodiscard]] virtual double formula(const Vec3& point_mm) const = 0;
};

using Shape = std::unique_ptr<AnalyticField>;

/// Every shape is a closed surface; `kernel_mm` is what kernel_width_mm answers everywhere.
[[nodiscard]] Shape sphere(double radius_mm, double kernel_mm, Pose pose = {});
/// Critical heights are known for the upright pose only.
[[nodiscard]] Shape ellipsoid(const Vec3& half_axes_mm, double kernel_mm, Pose pose = {});
/// The axis leans by `lean_degrees` from z towards x: 90 stands the ring upright, 0 lays it flat (a degenerate case:
/// two critical circles).
[[nodiscard]] Shape torus(double ring_mm, double tube_mm, double lean_degrees, double kernel_mm,
                          const Vec3& shift_mm = Vec3::Zero());
/// A figure eight of about 2.12 `size_mm` in height (upright pose), two holes one above the other.
[[nodiscard]] Shape genus_two(double size_mm, double kernel_mm, Pose pose = {});
/// A ball with two horns of unequal height: one saddle between two maxima.
[[nodiscard]] Shape two_bumps(double size_mm, double kernel_mm, Pose pose = {});
/// A ball flattened along y with a knob on either flank, just high enough for a top of its own. The steepest lines from
/// the bottom along y end there.
[[nodiscard]] Shape ball_with_knobs(double radius_mm, double kernel_mm);
/// A slab of `thickness_mm` with rounded rims, standing on its edge and turned a little, so that no face is level.
[[nodiscard]] Shape thin_wall(double width_mm, double height_mm, double thickness_mm, double kernel_mm);
/// Two balls of different size side by side, `gap_mm` apart.
[[nodiscard]] Shape near_touching_balls(double radius_mm, double gap_mm, double kernel_mm);
/// A box with level top and bottom and edges rounded by `edge_mm`: two plateaus, no other critical point.
[[nodiscard]] Shape flat_box(const Vec3& half_sizes_mm, double edge_mm, double kernel_mm, Pose pose = {});
/// Steps: a box on a larger box, so a plateau in mid-height besides top and bottom.
[[nodiscard]] Shape stepped_box(double size_mm, double edge_mm, double kernel_mm);
/// A plate with `holes` bores in a row, flat above and below: genus = holes.
[[nodiscard]] Shape bored_plate(int holes, double thickness_mm, double edge_mm, double kernel_mm);
/// A ball with a closed void inside.
[[nodiscard]] Shape hollow_sphere(double radius_mm, double wall_mm, double kernel_mm);
/// A leaning bowl: one outer minimum, the pocket's floor, one rim saddle, one rim maximum.
[[nodiscard]] Shape bowl(double radius_mm, double wall_mm, double kernel_mm);
/// Network of a gyroid inside a ball, rounded where they meet. Its Euler number is not known beforehand.
[[nodiscard]] Shape gyroid_ball(double radius_mm, double period_mm, double kernel_mm);
/// Star-shaped with bumps of several sizes, genus 0; many critical points.
[[nodiscard]] Shape bumpy(double radius_mm, double kernel_mm);

/// The same surface, out of reach of every sample within `radius_mm` of a place: a scan with a hole in it.
[[nodiscard]] Shape gapped(Shape whole, const Vec3& centre_mm, double radius_mm);

/// Contours of the exact slice at z, counted on a fine grid of inside/outside (independent of every tracer).
struct SliceCount {
  int outers = 0;
  int holes = 0;
  [[nodiscard]] int euler() const { return outers - holes; }
  friend bool operator==(const SliceCount&, const SliceCount&) = default;
};
[[nodiscard]] SliceCount count_slice(const AnalyticField& shape, double z_mm, double pitch_mm);
/// The same of whatever `inside` says within the box.
[[nodiscard]] SliceCount count_slice(const scan::Box3& box, const std::function<bool(const Vec3& place_mm)>& inside,
                                     double z_mm, double pitch_mm);

}  // namespace telefab::test
