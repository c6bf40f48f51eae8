// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/geometry/layer.hpp>
#include <vector>

namespace telefab::fab {

/// What a ring of a job belongs to. Files that can tell parts from supports do.
enum class PartKind : std::uint8_t { Part = 1, Supports = 2 };
[[nodiscard]] std::string_view name_of(PartKind kind);

/// One object of a job: its rings, layer by layer of the print. Outer rings counter-clockwise, holes clockwise.
struct ContourPart {
  PartKind kind = PartKind::Part;
  std::vector<std::vector<Contour>> layers;  ///< as many as the job has
  friend bool operator==(const ContourPart&, const ContourPart&) = default;
};

/// A print as contours, bottom first, build frame. Layer i reaches from i to i + 1 thicknesses above the platform.
/// Parts do not overlap.
struct ContourJob {
  std::string name;     ///< for people; may be empty
  std::string machine;  ///< name of its profile; may be empty
  double thickness_mm = 0;
  std::uint32_t layer_count = 0;
  Point2 platform_mm;  ///< size of the drawing, from the origin: where SVG turns y around
  std::vector<ContourPart> parts;
};

/// The rings of a stack as a job of one part.
[[nodiscard]] ContourJob contour_job(const LayerStack& stack, Point2 platform_mm);
/// The same print with supports: `supports[i]` are those of print layer i; the part stands `supports.size() -
/// layer_count` layers higher. What supports share with the part is cut off them.
/// Fails with InvalidInput where there are fewer layers of supports than of the part.
[[nodiscard]] Result<ContourJob> contour_job(const LayerStack& stack, Point2 platform_mm,
                                             std::vector<std::vector<Contour>> supports);

/// The rings of all parts in one layer as one region. Of a layer that only one part has, the rings as they are.
[[nodiscard]] Result<std::vector<Contour>> united(const ContourJob& job, std::uint32_t layer);
/// Of all rings; a box of zero size at the origin where there is none.
[[nodiscard]] Bounds2 bounds_of(const ContourJob& job);
[[nodiscard]] std::uint64_t vertex_count(const ContourJob& job);

}  // namespace telefab::fab
