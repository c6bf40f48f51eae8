// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>

namespace telefab::test {

struct LasOptions {
  std::uint8_t minor = 2;   ///< LAS 1.minor
  std::uint8_t format = 0;  ///< point format, 0 to 10
  Eigen::Vector3d scale = Eigen::Vector3d::Constant(0.001);
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  std::uint16_t extra_bytes = 0;  ///< of every record, behind what the format asks for
  std::int64_t withheld = -1;     ///< index of a point marked as deleted
};

/// A LAS file whose points have these whole numbers as coordinates.
[[nodiscard]] std::string las_file(std::span<const std::array<std::int32_t, 3>> points, const LasOptions& options);

}  // namespace telefab::test
