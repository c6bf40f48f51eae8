// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <telefab/geometry/layer.hpp>

namespace telefab::fab {

// How much room a job takes on the fab's disk, before it is known: estimates from above, some twice what plans of real
// scans took (decision 0809 has the figures and where each part of the formula comes from).

/// Bytes for the layers of an offered job and the plan to come. Of the job only the header is known: its contours are
/// taken for twice as long as the outline of its box on every layer.
[[nodiscard]] std::uint64_t offer_room_bytes(const StackHeader& header);
/// Bytes for the plan of a job whose layers are here. `contour_bytes`: of its chunks.
[[nodiscard]] std::uint64_t plan_room_bytes(const LayerStack& stack, std::uint64_t contour_bytes);

}  // namespace telefab::fab
