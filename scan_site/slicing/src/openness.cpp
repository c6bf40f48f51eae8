// SPDX-License-Identifier: GPL-3.0-or-later
#include "openness.hpp"

#include <fmt/format.h>

#include <array>

namespace telefab::scan {
namespace {

/// Samples asked at most; more tell nothing new.
constexpr std::size_t kAsked = 100'000;
/// Closed clouds of even density stay below 0.04 of their area, uneven ones below 0.12; a missing side is 0.2 and more.
constexpr double kOpenShare = 0.15;
/// Cosine: a missing side this near to an axis is named after it.
constexpr double kAlongAxis = 0.7;

}  // namespace

Openness openness_of(const MlsField& field) {
  const double spacings = field.kernel().spacing_mm / field.kernel().kernel_mm;
  const Box3 box = field.bounds();
  SurfaceSamples all;
  field.samples_between(box.min.z(), box.max.z(), all);
  const std::size_t stride = all.points.size() / kAsked + 1;
  Openness open;
  for (std::size_t i = 0; i < all.points.size(); i += stride) {
    const double spacing = spacings * field.kernel_width_mm(all.points[i]);
    const double area = static_cast<double>(stride) * spacing * spacing;
    open.seen_mm2 += area;
    open.missing_mm2 -= area * all.normals[i];
  }
  return open;
}

std::optional<std::string> warning_of(const Openness& open) {
  if (open.share() < kOpenShare) return std::nullopt;
  static constexpr std::array<std::array<const char*, 2>, 3> kSides{
      {{"towards -x", "towards +x"}, {"towards -y", "towards +y"}, {"down", "up"}}};
  const Vec3 way = open.missing_mm2.normalized();
  int axis = 0;
  way.cwiseAbs().maxCoeff(&axis);
  const std::string side = std::abs(way[axis]) >= kAlongAxis
                               ? kSides[static_cast<std::size_t>(axis)][way[axis] > 0 ? 1 : 0]
                               : fmt::format("towards ({:.2f}, {:.2f}, {:.2f})", way.x(), way.y(), way.z());
  return fmt::format("the scan is open: about {:.3g} cm2 of surface facing {} have no samples; {}",
                     open.missing_mm2.norm() / 100, side,
                     side == "down" ? "--close-base closes it at the platform" : "scan that side too");
}

}  // namespace telefab::scan
