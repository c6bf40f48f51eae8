// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// Watches the layers on their way out and holds them, when all are written, against the part that was asked for.
class WrittenCheck {
 public:
  /// `size_mm`: of the placed scan; `spacing_mm`: of its samples.
  WrittenCheck(const Vec3& size_mm, double spacing_mm) : size_mm_{size_mm}, spacing_mm_{spacing_mm} {}

  /// Flags a layer without contours well inside the height of the scan.
  void look_at(Layer& layer);
  /// What does not fit, for people. Fails: InvalidInput (no layer has a contour, or they span less than half of the
  /// height). `whole`: all layers of the part passed.
  [[nodiscard]] Result<std::vector<std::string>> verdict(const StackHeader& header, bool whole) const;

 private:
  Vec3 size_mm_;
  double spacing_mm_;
  std::vector<std::uint32_t> empty_;
  std::optional<std::uint32_t> first_, last_;  ///< with a contour
  Bounds2 bounds_ = Bounds2::nothing();
};

}  // namespace telefab::scan
