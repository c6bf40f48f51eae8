// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {
namespace {

/// Resins shrink by a few in a hundred; a factor beyond these is a mistake.
constexpr double kLeastAxisScale = 0.8;
constexpr double kMostAxisScale = 1.25;

bool is_positive(const std::optional<double>& value, double most) {
  return !value || (std::isfinite(*value) && *value > 0 && *value <= most);
}

char letter_of(MirrorAxis axis) { return "xyz"[static_cast<std::size_t>(axis) - 1]; }

}  // namespace

Result<MirrorAxis> mirror_axis_from(std::string_view name) {
  if (name == "x") return MirrorAxis::X;
  if (name == "y") return MirrorAxis::Y;
  if (name == "z") return MirrorAxis::Z;
  return fail(ErrorCode::InvalidInput, fmt::format("no axis to mirror named \"{}\"; there are x, y, z", name));
}

Result<Vec3> axis_scale_from(std::string_view text) {
  const auto factors = numbers_from(text);
  if (!factors) return fail_in("scale_axes", factors.error());
  if (factors->size() != 3)
    return fail(ErrorCode::InvalidInput,
                fmt::format("scale_axes: \"{}\" must be three factors X,Y,Z, such as 1.02,1.02,1.015", text));
  return Vec3{(*factors)[0], (*factors)[1], (*factors)[2]};
}

Result<Point2> position_from(std::string_view text) {
  const auto place = numbers_from(text);
  if (!place) return fail_in("position", place.error());
  if (place->size() != 2)
    return fail(ErrorCode::InvalidInput,
                fmt::format("position: \"{}\" must be X,Y, millimetres on the platform of the part's middle", text));
  return Point2{(*place)[0], (*place)[1]};
}

Result<void> PlacementOptions::validate() const {
  if ((height_mm ? 1 : 0) + (scale ? 1 : 0) + (fit ? 1 : 0) > 1)
    return fail(ErrorCode::InvalidInput, "give one of height, scale and fit, not several");
  if (!is_positive(height_mm, kMaxCoordinateMm))
    return fail(ErrorCode::InvalidInput, fmt::format("height {} mm is not in (0, {}]", *height_mm, kMaxCoordinateMm));
  if (!is_positive(scale, 1e9))
    return fail(ErrorCode::InvalidInput, fmt::format("scale {} is not in (0, 1e9]", *scale));
  if (!is_positive(unit_mm, 1e9))
    return fail(ErrorCode::InvalidInput, fmt::format("a unit of {} mm is not in (0, 1e9]", *unit_mm));
  if (scale && unit_mm)
    return fail(ErrorCode::InvalidInput, "a scale and a unit say the same thing twice; give one of them");
  for (const double factor : axis_scale)
    if (!(factor >= kLeastAxisScale && factor <= kMostAxisScale))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("an axis scaled by {} is not within {} to {}: shrinkage is made good with it, sizes are "
                              "for height and scale",
                              factor, kLeastAxisScale, kMostAxisScale));
  if (position_mm && !(std::isfinite(position_mm->x_mm) && std::isfinite(position_mm->y_mm)))
    return fail(ErrorCode::InvalidInput, "a position is two finite numbers");
  return {};
}

std::string to_json(const PlacementOptions& placement) {
  nlohmann::ordered_json placing{{"rotate", rotate_text(placement.turn)}};
  if (placement.mirror) placing["mirror"] = std::string(1, letter_of(*placement.mirror));
  placing["scale_axes"] = {placement.axis_scale.x(), placement.axis_scale.y(), placement.axis_scale.z()};
  if (const auto& at = placement.position_mm) placing["position_mm"] = {at->x_mm, at->y_mm};
  return json_text(placing);
}

std::string sentence_of(const PlacementOptions& placement) {
  std::vector<std::string> done;
  if (placement.mirror) done.push_back(fmt::format("mirrored in {}", letter_of(*placement.mirror)));
  if (!placement.turn.is_none())
    done.push_back(fmt::format("turned by {} degrees about the axes of the scan", rotate_text(placement.turn)));
  if (const Vec3& a = placement.axis_scale; a != Vec3::Ones())
    done.push_back(fmt::format("larger by {:g}, {:g} and {:g} along x, y and z", a.x(), a.y(), a.z()));
  if (const auto& at = placement.position_mm)
    done.push_back(fmt::format("its middle at {:g}, {:g} mm", at->x_mm, at->y_mm));
  return fmt::format("{}", fmt::join(done, ", "));
}

}  // namespace telefab::scan
