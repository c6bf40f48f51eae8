// SPDX-License-Identifier: GPL-3.0-or-later
#include "openness.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace telefab::scan {
namespace {

/// Cosine: a missing side this near to an axis is named after it.
constexpr double kAlongAxis = 0.7;

std::string side_of(const Openness& open) {
  static constexpr std::array<std::array<const char*, 2>, 3> kSides{
      {{"towards -x", "towards +x"}, {"towards -y", "towards +y"}, {"down", "up"}}};
  const Vec3 way = open.missing_mm2.normalized();
  int axis = 0;
  way.cwiseAbs().maxCoeff(&axis);
  return std::abs(way[axis]) >= kAlongAxis ? kSides[static_cast<std::size_t>(axis)][way[axis] > 0 ? 1 : 0]
                                           : fmt::format("towards ({:.2f}, {:.2f}, {:.2f})", way.x(), way.y(), way.z());
}

/// A scan without underside may be meant so: where most of what is missing faces down, or little enough is without it.
const char* base_hint(const Openness& open) {
  Openness rest = open;
  rest.missing_mm2.z() = std::max(0.0, rest.missing_mm2.z());
  const bool helps = open.missing_mm2.z() < -kAlongAxis * open.missing_mm2.norm() ||
                     (open.share() > kMostOpenShare && rest.share() <= kMostOpenShare);
  return helps ? ", or say --base flat for a part that is cut at the platform" : "";
}

}  // namespace

std::optional<std::string> warning_of(const Openness& open) {
  if (open.share() < kSilentShare) return std::nullopt;
  return fmt::format(
      "the scan is open: about {:.3g} cm2 of surface facing {} have no samples ({:.0f} % of what it shows); how the "
      "part looks there is a guess; scan that side too{}",
      open.missing_mm2.norm() / 100, side_of(open), 100 * open.share(), base_hint(open));
}

std::optional<std::string> refusal_of(const Openness& open) {
  if (open.share() <= kMostOpenShare) return std::nullopt;
  return fmt::format(
      "the scan shows too little of the object: about {:.3g} cm2 of surface facing {} have no samples ({:.0f} % of "
      "what "
      "it shows), too much to be guessed; scan that side too{}, give --thickness-mm for a sheet or relief scanned from "
      "one side, or --complete off to close it flat",
      open.missing_mm2.norm() / 100, side_of(open), 100 * open.share(), base_hint(open));
}

}  // namespace telefab::scan
