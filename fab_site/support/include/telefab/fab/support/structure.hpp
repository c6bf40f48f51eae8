// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <string_view>
#include <telefab/fab/region/region.hpp>
#include <vector>

namespace telefab::fab {

/// A point of the print: build frame, z upwards from the platform (the elevation included).
struct Point3 {
  double x_mm = 0;
  double y_mm = 0;
  double z_mm = 0;
  friend bool operator==(const Point3&, const Point3&) = default;
};

enum class SupportElementKind : std::uint8_t { Tip = 1, Arm = 2, Pin = 3, Foot = 4, Brace = 5, ThinPin = 6 };
[[nodiscard]] std::string_view name_of(SupportElementKind kind);

/// A cone, a cylinder or a slanted cylinder: every level section is a disc whose centre and radius run linearly
/// from bottom to top. Invariant by use: bottom below top, radii not negative.
struct SupportElement {
  SupportElementKind kind = SupportElementKind::Pin;
  Point3 bottom;
  Point3 top;
  double bottom_radius_mm = 0;
  double top_radius_mm = 0;
  friend bool operator==(const SupportElement&, const SupportElement&) = default;
};

/// A base plate: everything within the radius of what its corners enclose, from the platform up. Its upper half is
/// bevelled by 45 degrees; its lower half recedes from upright, so that a scraper gets under it.
struct Plate {
  std::vector<Point2> corners;  ///< of a convex ring, counter-clockwise; one: a disc, two: a bar
  double radius_mm = 0;         ///< at half height, where it is widest
  double height_mm = 0;
  double lip = 0;  ///< >= 0; tangent of how far the lower half recedes
  [[nodiscard]] double radius_at(double z_mm) const;
  friend bool operator==(const Plate&, const Plate&) = default;
};

/// Where it is widest.
[[nodiscard]] double area_mm2(const Plate& plate);

/// The ring at some distance around the corners of a convex ring, arcs of so many chords at each; the number of points
/// depends on neither radius nor place.
[[nodiscard]] std::vector<Point2> ring_around(std::span<const Point2> corners, double radius_mm, int chords);

/// Everything that holds a part, as primitives whose level sections are known in closed form.
struct Structure {
  std::vector<SupportElement> elements;
  std::vector<Plate> plates;
  friend bool operator==(const Structure&, const Structure&) = default;
};

/// Sum of the primitives' volumes in closed form; where they overlap (joints, plates of a group, the bevel) it counts
/// twice, so it errs upwards.
[[nodiscard]] double volume_mm3(const Structure& structure);

/// Sections of a structure by level planes at the middle of each layer, in a time that depends on what is there.
class StructureSections {
 public:
  /// `thickness_mm` > 0; `layers`: print layers up to which sections are asked for.
  StructureSections(Structure structure, double thickness_mm, std::uint32_t layers, Millimetres arc_tolerance);
  [[nodiscard]] const Structure& structure() const { return structure_; }
  /// The section of that print layer; empty above the structure.
  [[nodiscard]] Region section(LayerIndex print_layer) const;
  /// Whether another structure's section of that print layer is made of the same primitives in the same order: then
  /// the sections are equal. Of the same thickness and tolerance.
  [[nodiscard]] bool has_same_section(const StructureSections& other, LayerIndex print_layer) const;

 private:
  Structure structure_;
  double thickness_mm_;
  Millimetres arc_tolerance_;
  std::vector<std::vector<std::uint32_t>> elements_at_;
  std::uint32_t plate_layers_ = 0;
};

}  // namespace telefab::fab
