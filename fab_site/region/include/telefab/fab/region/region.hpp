// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/base/quantity.hpp>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// One step of the integer grid all regions live on is a nanometre: far below any pixel, and 10 m still fits.
inline constexpr double kGridStepsPerMm = 1e6;

struct GridPoint {
  std::int64_t x = 0;  ///< nanometres, build frame
  std::int64_t y = 0;
  friend bool operator==(const GridPoint&, const GridPoint&) = default;
};
using GridRing = std::vector<GridPoint>;

[[nodiscard]] GridPoint to_grid(Point2 point);
[[nodiscard]] Point2 to_mm(GridPoint point);
/// What a ring of at least one vertex encloses; below 0 where it turns clockwise, as holes do.
[[nodiscard]] double area_mm2(const GridRing& ring);

/// A flat set with holes, in any number of pieces, on the integer grid. Boolean operations are closed: whatever
/// touches, crosses, repeats or is thin on the way in, what comes out is again a valid region.
/// Invariant: the rings come from a boolean operation; outer rings run counter-clockwise, holes clockwise, none
/// cross; the winding number is 1 inside and 0 outside.
class Region {
 public:
  Region() = default;

  /// What the rings enclose with a positive winding number: overlapping outer rings are joined, a hole inside two
  /// overlapping outers is filled once. Fails with InvalidInput for a coordinate beyond kMaxCoordinateMm.
  [[nodiscard]] static Result<Region> from_contours(std::span<const Contour> contours);
  /// The same for rings on the grid. `even_odd` takes rings of unknown direction.
  [[nodiscard]] static Result<Region> from_rings(std::span<const GridRing> rings, bool even_odd = false);

  [[nodiscard]] std::span<const GridRing> rings() const { return rings_; }
  /// In canonical order; rings that are flat on conversion are left out.
  [[nodiscard]] std::vector<Contour> to_contours() const;
  [[nodiscard]] bool empty() const { return rings_.empty(); }
  [[nodiscard]] double area_mm2() const;
  /// A box of zero size at the origin for an empty region.
  [[nodiscard]] Bounds2 bounds() const;
  /// The boundary counts as inside.
  [[nodiscard]] bool contains(Point2 point) const;
  /// Connected pieces, each an outer ring with its holes, in the order of their lowest, leftmost vertex.
  [[nodiscard]] std::vector<Region> pieces() const;

  friend bool operator==(const Region&, const Region&) = default;

 private:
  friend struct RegionMaker;
  explicit Region(std::vector<GridRing> rings) : rings_{std::move(rings)} {}
  std::vector<GridRing> rings_;
};

[[nodiscard]] Region unite(const Region& a, const Region& b);
[[nodiscard]] Region unite(std::span<const Region> regions);
[[nodiscard]] Region intersect(const Region& a, const Region& b);
[[nodiscard]] Region subtract(const Region& a, const Region& b);

/// Every point within `distance` of the region (positive), or every point farther than that from its outside
/// (negative). Round joins, made of chords whose sagitta is at most `arc_tolerance`; arcs err to the inside.
[[nodiscard]] Region offset(const Region& region, Millimetres distance, Millimetres arc_tolerance);

/// Leaves out vertices that lie within `tolerance` of the chord that replaces them (Douglas and Peucker). The
/// boundary moves by at most `tolerance`; pieces thinner than that may vanish.
[[nodiscard]] Region simplified(const Region& region, Millimetres tolerance);

/// A point inside, in the middle of the widest stretch of the level line through the middle of the first ring's box.
/// The origin for an empty region.
[[nodiscard]] Point2 inner_point(const Region& region);

/// A round polygon of the grid, its vertices on the circle.
[[nodiscard]] Region disc(Point2 centre, Millimetres radius, Millimetres arc_tolerance);

}  // namespace telefab::fab
