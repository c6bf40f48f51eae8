// SPDX-License-Identifier: GPL-3.0-or-later
#include "tip_shape.hpp"

#include <algorithm>
#include <numbers>

namespace telefab::fab {
namespace {

/// Radii of a class, shafts before their height is thought of: tips of 0.4, 0.6 and 0.8 mm where light ones have 0.4.
struct Width {
  double disc_mm = 0, pin_mm = 0;
};
Width width_of(TipClass tip, const MachineProfile::Supports& s) {
  const auto or_light = [&](double stated, double times) { return stated > 0 ? stated : times * s.tip_radius_mm; };
  switch (tip) {
    case TipClass::Light:
      break;
    case TipClass::Medium:
      return {or_light(s.medium_tip_radius_mm, 1.5), 1.25 * s.pin_radius_mm};
    case TipClass::Heavy:
      return {or_light(s.heavy_tip_radius_mm, 2), 1.5 * s.pin_radius_mm};
  }
  return {s.tip_radius_mm, s.pin_radius_mm};
}

/// A heavy tip on a pin so many of its shaft's light radii high is as soft as others try to be.
constexpr double kModelHeight = 10;
/// Limits of a shaft's radius over what its class has by itself: at its upper end, where it is short, and at its foot.
constexpr double kLeastShaft = 0.6, kMostShaft = 1.6;
constexpr double kWaist = 0.75;  ///< radius over the disc's

/// Any shape of a class; the shaft has these radii.
TipShape with_shaft(const MachineProfile& machine, TipClass tip, double pin_mm, double base_mm, double layer_mm) {
  const MachineProfile::Supports& s = machine.supports;
  TipShape shape;
  shape.disc_mm = width_of(tip, s).disc_mm;
  shape.depth_mm = std::max(layer_mm, s.tip_depth_mm > 0 ? s.tip_depth_mm : shape.disc_mm);
  // A waist that is no wider than a pixel would not show.
  shape.neck_mm = std::min(shape.disc_mm, std::max(kWaist * shape.disc_mm, 1.2 * machine.projection.pixel_pitch_mm));
  shape.tip_mm = shape.disc_mm + layer_mm;
  shape.pin_mm = std::max(pin_mm, shape.disc_mm);
  shape.base_mm = std::max(base_mm, shape.disc_mm);
  shape.cone_mm = 2.5 * (shape.pin_mm - shape.disc_mm) + layer_mm;
  shape.foot_mm = s.foot_radius_mm + shape.base_mm - s.pin_radius_mm;
  shape.foot_height_mm = foot_height_mm(s);
  return shape;
}

}  // namespace

double TipShape::neck_area_mm2() const { return std::numbers::pi * neck_mm * neck_mm; }

double TipShape::softness(double height_mm) const {
  // A cone's length over area is its length over pi times both radii.
  const double below = std::max(0.0, height_mm - length_mm()), foot = std::min(below, foot_height_mm);
  return (tip_mm / (neck_mm * disc_mm) + cone_mm / (neck_mm * pin_mm) + (below - foot) / (pin_mm * base_mm) +
          foot / (base_mm * foot_mm)) /
         std::numbers::pi;
}

double foot_height_mm(const MachineProfile::Supports& supports) {
  const bool has_plate = supports.raft != RaftKind::None && supports.base_thickness_mm > 0;
  return has_plate ? supports.base_thickness_mm : supports.base_thickness_mm + supports.foot_radius_mm;
}

TipShape tip_shape(const MachineProfile& machine, TipClass tip, double height_mm, double layer_mm) {
  const double light = machine.supports.pin_radius_mm, own = width_of(tip, machine.supports).pin_mm;
  const auto shape = [&](double pin, double base) { return with_shaft(machine, tip, pin, base, layer_mm); };
  const double heavy = width_of(TipClass::Heavy, machine.supports).pin_mm;
  const TipShape model = with_shaft(machine, TipClass::Heavy, heavy, heavy, layer_mm);
  const double wanted = model.softness(kModelHeight * light) * model.neck_area_mm2() / shape(own, own).neck_area_mm2();
  // Narrower all along where that is too stiff, else wider towards the foot.
  const bool is_short = shape(own, own).softness(height_mm) < wanted;
  double narrow = is_short ? kLeastShaft * own : own, wide = is_short ? own : kMostShaft * own;
  for (int halving = 0; halving < 24; ++halving) {
    const double radius = (narrow + wide) / 2;
    const bool is_soft = (is_short ? shape(radius, radius) : shape(own, radius)).softness(height_mm) > wanted;
    (is_soft ? narrow : wide) = radius;
  }
  return is_short ? shape(narrow, narrow) : shape(own, wide);
}

}  // namespace telefab::fab
