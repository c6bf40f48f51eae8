// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <string>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

/// Triangles of one kind of body, millimetres, build frame of the print; outward. Every body in it is closed, but
/// bodies overlap and touch.
struct TriangleMesh {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Part and supports for a viewer: each layer of the part a closed slab, elements and plates closed solids.
struct StructureMesh {
  TriangleMesh part;
  TriangleMesh supports;
};

/// Contours are simplified by the tolerance first. Layers whose contours cannot be read are left out.
[[nodiscard]] StructureMesh structure_mesh(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                                           Millimetres tolerance);

/// As a binary PLY with a colour at every vertex: the part grey, supports orange.
[[nodiscard]] std::string to_ply(const StructureMesh& mesh);

}  // namespace telefab::fab
