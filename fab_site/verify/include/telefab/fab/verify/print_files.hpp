// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>
#include <telefab/fab/verify/support_check.hpp>

namespace telefab::fab {

/// Anchors and primitives as supports.json tells them, read and cut into layers without the planner's code.
class WrittenSupports {
 public:
  /// Fails with InvalidInput and names what is missing or not a number.
  [[nodiscard]] static Result<WrittenSupports> from_json(std::string_view text);
  [[nodiscard]] std::uint32_t elevation_layers() const { return elevation_layers_; }
  [[nodiscard]] const std::vector<std::pair<Point2, LayerIndex>>& anchors() const { return anchors_; }
  /// Rings at the middle of a print layer; they overlap where primitives do.
  [[nodiscard]] std::vector<Contour> section(LayerIndex print_layer, double thickness_mm) const;

 private:
  struct Cone {
    double x0, y0, z0, r0, x1, y1, z1, r1;
  };
  struct Slab {
    std::vector<Point2> corners;
    double radius, height, lip;
  };
  std::uint32_t elevation_layers_ = 0;
  std::vector<std::pair<Point2, LayerIndex>> anchors_;
  std::vector<Cone> cones_;
  std::vector<Slab> slabs_;
};

}  // namespace telefab::fab
