// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/base/result.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan {

/// Which stretches of a layer's contours its doubts concern. A doubt about one place leaves the rest of the plane as
/// good as it was.
class DoubtfulPlaces {
 public:
  /// What runs within this distance of the place.
  void add(Point2 place, double reach_mm) { places_.push_back({place, reach_mm}); }
  /// Where the layer's contours and those that somebody else found part: stretches of either that run farther than half
  /// a kernel from the other, or else a smaller part of one. A place among them; none, and all is doubtful, where both
  /// run along each other to within a hundredth of `width_mm`.
  std::optional<Point2> add_difference(std::span<const Contour> found, std::span<const Contour> other, double width_mm);
  /// What runs within this distance of one of the places; says of each whether anything does.
  std::vector<bool> add_beside(std::span<const Contour> contours, std::span<const Point2> places, double reach_mm);
  /// What holds for the plane as a whole: a count that is not explained, contours that are missing.
  void add_all() { all_ = true; }

  /// Makes the stretches doubtful that the places concern, the nearest edge where none is in reach. A layer without
  /// contours stays as it is. Fails: Internal.
  [[nodiscard]] Result<void> mark(Layer& layer) const;

 private:
  struct Place {
    Point2 at;
    double reach_mm;
  };
  std::vector<Place> places_;
  bool all_ = false;
};

}  // namespace telefab::scan
