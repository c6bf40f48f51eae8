// SPDX-License-Identifier: GPL-3.0-or-later
#include "openness.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <telefab/scan/slicing/surface_survey.hpp>

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

Openness unasked(Openness open, const SliceRequest& request) {
  if (request.flat_base) open.missing_mm2.z() = std::max(0.0, open.missing_mm2.z());
  return open;
}

Result<void> check_openness(const Openness& open, const SliceRequest& request) {
  if (!request.complete || request.thickness_mm) return {};
  if (const auto why = refusal_of(unasked(open, request))) return fail(ErrorCode::InvalidInput, *why);
  return {};
}

StoodOpenness judged_openness(const Openness& open, const SliceRequest& request, const Turn& turn) {
  Vec3 signs = Vec3::Ones();
  if (const auto mirror = request.placement.mirror) signs[static_cast<Eigen::Index>(*mirror) - 1] = -1;
  const Openness stood{open.seen_mm2, turn.matrix() * signs.cwiseProduct(open.missing_mm2)};
  StoodOpenness judged;
  if (const auto ok = check_openness(stood, request); !ok)
    judged.refusal = ok.error().what;
  else if (!request.thickness_mm)
    judged.warning = warning_of(unasked(stood, request));
  return judged;
}

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
