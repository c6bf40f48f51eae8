// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <vector>

namespace telefab::scan {

using PointColour = std::array<std::uint8_t, 3>;  ///< red, green, blue

/// Binary little-endian PLY with what the cloud has: positions (float, or double where the origin is not zero),
/// normals, confidence, sheets_apart, and `colours` (none, or one a point). `comment` goes into the header, one line.
[[nodiscard]] std::vector<std::byte> write_ply(const PointCloud& cloud, std::span<const PointColour> colours,
                                               std::string_view comment);

/// One range image as PLY with a range_grid element, as Stanford's files have it.
[[nodiscard]] std::vector<std::byte> write_range_ply(std::span<const Eigen::Vector3f> points, const RangeView& view,
                                                     std::string_view comment);

}  // namespace telefab::scan
