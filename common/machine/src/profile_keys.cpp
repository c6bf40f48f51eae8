// SPDX-License-Identifier: GPL-3.0-or-later
#include "profile_keys.hpp"

#include <fmt/format.h>

namespace telefab {
namespace {

using P = MachineProfile;

template <class Section, class Value>
std::function<Value&(P&)> at(Section P::*section, Value Section::*value) {
  return [=](P& profile) -> Value& { return profile.*section.*value; };
}

/// Of a stroke in the section [motion].
std::function<double&(P&)> at(P::Stroke P::Motion::*stroke, double P::Stroke::*value) {
  return [=](P& profile) -> double& { return profile.motion.*stroke.*value; };
}

template <class Section, MachineWord Word>
WordKey words(Section P::*section, Word Section::*value) {
  return {[=](const P& profile) { return name_of(profile.*section.*value); },
          [=](P& profile, std::string_view name) {
            const auto word = machine_word_from<Word>(name);
            if (word) profile.*section.*value = *word;
            return word.has_value();
          },
          kMachineWords<Word>};
}

}  // namespace

const std::vector<Key>& profile_keys() {
  static const std::vector<Key> table{
      {"platform", "width_mm", true, "along x, the mask's columns",
       NumberKey{at(&P::platform, &P::Platform::width_mm), 0.1, 2000}},
      {"platform", "depth_mm", true, "along y, the mask's rows",
       NumberKey{at(&P::platform, &P::Platform::depth_mm), 0.1, 2000}},
      {"platform", "z_travel_mm", true, "tallest part with its base",
       NumberKey{at(&P::platform, &P::Platform::z_travel_mm), 0.1, 2000}},
      {"platform", "most_peel_mm2", false,
       "largest layer that its lift can pull off the vat; more holds the job; 0: not stated",
       NumberKey{at(&P::platform, &P::Platform::most_peel_mm2), 0, 1e7}},
      {"platform", "least_layer_mm", false, "thinnest layer of this printer; 0: not stated",
       NumberKey{at(&P::platform, &P::Platform::least_layer_mm), 0, 1}, Written::UnlessDefault},
      {"platform", "most_layer_mm", false, "thickest layer of this printer; 0: not stated",
       NumberKey{at(&P::platform, &P::Platform::most_layer_mm), 0, 1}, Written::UnlessDefault},
      {"projection", "pixel_pitch_mm", true, "one pixel on the vat",
       NumberKey{at(&P::projection, &P::Projection::pixel_pitch_mm), 0.001, 1}},
      {"projection", "width_px", false, "pixels along x; must be what width and pitch give; 0: not stated",
       CountKey{at(&P::projection, &P::Projection::width_px), 0, 65535}, Written::UnlessDefault},
      {"projection", "height_px", false, "pixels along y; must be what depth and pitch give; 0: not stated",
       CountKey{at(&P::projection, &P::Projection::height_px), 0, 65535}, Written::UnlessDefault},
      {"projection", "orientation", false, "what the optics do to a mask",
       words(&P::projection, &P::Projection::orientation)},
      {"projection", "controllers", false, "who drives which half of the mirrors",
       words(&P::projection, &P::Projection::controllers)},
      {"projection", "spread_px", false, "sigma of one pixel's Gaussian light spot",
       NumberKey{at(&P::projection, &P::Projection::spread_px), 0.05, 5}},
      {"projection", "gamma", false, "relative irradiance = (grey/255)^gamma, unless there is a curve",
       NumberKey{at(&P::projection, &P::Projection::gamma), 0.3, 4}},
      {"projection", "curve", false, "measured relative irradiance at equally spaced greys, instead of gamma",
       CurveKey{at(&P::projection, &P::Projection::curve)}},
      {"projection", "leak", false, "share of full irradiance that black leaks",
       NumberKey{at(&P::projection, &P::Projection::leak), 0, 0.1}},
      // Below a twentieth an edge has no light to speak of: that is a broken lens, not a field.
      {"projection", "field", false, "share of the irradiance at the middles of equal cells, rows from back to front",
       GridKey{at(&P::projection, &P::Projection::field), 0.05, 1}},
      {"projection", "irradiance_mw_per_cm2", true, "of a white area on the vat",
       NumberKey{at(&P::projection, &P::Projection::irradiance_mw_per_cm2), 0.01, 1000}},
      {"layers", "thickness_mm", true, "height of one layer",
       NumberKey{at(&P::layers, &P::Layers::thickness_mm), 0.001, 1}},
      {"layers", "exposure_s", true, "of a normal layer",
       NumberKey{at(&P::layers, &P::Layers::exposure_s), 0.001, 300}},
      {"layers", "bottom_count", false, "layers with the longer exposure",
       CountKey{at(&P::layers, &P::Layers::bottom_count), 0, 100}},
      {"layers", "bottom_exposure_s", true, "of a bottom layer",
       NumberKey{at(&P::layers, &P::Layers::bottom_exposure_s), 0.001, 600}},
      {"layers", "bottom_factor", false, "exposure of a bottom layer over that of a normal one, where it is derived",
       NumberKey{at(&P::layers, &P::Layers::bottom_factor), 1, 100}, Written::UnlessDefault},
      {"layers", "transition_count", false,
       "layers behind the bottom ones whose exposure falls in even steps to the normal one",
       CountKey{at(&P::layers, &P::Layers::transition_count), 0, 100}, Written::UnlessDefault},
      {"layers", "light_share", false,
       "power of the light as share of full: a longer exposure at less light; projection.irradiance_mw_per_cm2 is of "
       "full light",
       NumberKey{at(&P::layers, &P::Layers::light_share), 0.01, 1}, Written::UnlessDefault},
      {"layers", "bottom_light_share", false, "of the bottom layers; 0: as light_share",
       NumberKey{at(&P::layers, &P::Layers::bottom_light_share), 0, 1}, Written::UnlessDefault},
      {"resin", "name", false, "for people", TextKey{at(&P::resin, &P::Resin::name)}},
      {"resin", "maker", false, "for people", TextKey{at(&P::resin, &P::Resin::maker)}, Written::UnlessDefault},
      {"resin", "critical_dose_mj_per_cm2", false, "Ec",
       NumberKey{at(&P::resin, &P::Resin::critical_dose_mj_per_cm2), 0.01, 10000}},
      {"resin", "penetration_mm", false, "Dp", NumberKey{at(&P::resin, &P::Resin::penetration_mm), 0.001, 10}},
      {"resin", "critical_dose_least_mj_per_cm2", false,
       "Ec is this or more, with 95 % confidence: `calibrate fit` says so; 0: not measured",
       NumberKey{at(&P::resin, &P::Resin::critical_dose_least_mj_per_cm2), 0, 10000}},
      {"resin", "critical_dose_most_mj_per_cm2", false, "and this or less",
       NumberKey{at(&P::resin, &P::Resin::critical_dose_most_mj_per_cm2), 0, 10000}},
      {"resin", "penetration_least_mm", false,
       "Dp is this or more, with 95 % confidence: `calibrate fit` says so; 0: not measured",
       NumberKey{at(&P::resin, &P::Resin::penetration_least_mm), 0, 10}},
      {"resin", "penetration_most_mm", false, "and this or less",
       NumberKey{at(&P::resin, &P::Resin::penetration_most_mm), 0, 10}},
      {"resin", "calibration_correlation", false, "of the errors of Dp and of the logarithm of Ec, which one fit found",
       NumberKey{at(&P::resin, &P::Resin::calibration_correlation), -1, 1}},
      {"resin", "vat_ml", false, "resin that the vat holds; a job that needs more is held; 0: not stated",
       NumberKey{at(&P::resin, &P::Resin::vat_ml), 0, 1e6}},
      {"resin", "green_strength_mpa", false,
       "strength of printed resin before it is washed and cured; 0: not stated, then 10 is assumed, about half of the "
       "softest figure found (18.6, Formlabs sheet of Durable, green); flexible resins: a quarter, assumed",
       NumberKey{at(&P::resin, &P::Resin::green_strength_mpa), 0, 1000}},
      {"resin", "green_modulus_mpa", false,
       "flexural modulus of printed resin before it is washed and cured, by which pins buckle; 0: not stated, then 160 "
       "is assumed (Formlabs sheet of Durable, green)",
       NumberKey{at(&P::resin, &P::Resin::green_modulus_mpa), 0, 100000}, Written::UnlessDefault},
      {"resin", "viscosity_mpa_s", false, "at 25 degrees Celsius; 0: not stated",
       NumberKey{at(&P::resin, &P::Resin::viscosity_mpa_s), 0, 1e6}, Written::UnlessDefault},
      {"resin", "density_g_per_ml", false, "of the liquid; 0: not stated",
       NumberKey{at(&P::resin, &P::Resin::density_g_per_ml), 0, 10}, Written::UnlessDefault},
      {"resin", "temperature_least_celsius", false, "its maker prints it at this or more; 0: not stated",
       NumberKey{at(&P::resin, &P::Resin::temperature_least_celsius), 0, 150}, Written::UnlessDefault},
      {"resin", "temperature_most_celsius", false, "and at this or less; 0: not stated",
       NumberKey{at(&P::resin, &P::Resin::temperature_most_celsius), 0, 150}, Written::UnlessDefault},
      {"resin", "shrink_x_percent", false,
       "of a part that is washed and cured: what it lacks of its drawn length along x; below 0: it has grown",
       NumberKey{at(&P::resin, &P::Resin::shrink_x_percent), -5, 10}, Written::UnlessDefault},
      {"resin", "shrink_y_percent", false, "along y", NumberKey{at(&P::resin, &P::Resin::shrink_y_percent), -5, 10},
       Written::UnlessDefault},
      {"resin", "shrink_z_percent", false, "along z", NumberKey{at(&P::resin, &P::Resin::shrink_z_percent), -5, 10},
       Written::UnlessDefault},
      {"resin", "hole_growth_mm", false, "to be added to the radius of a hole: holes come out smaller by so much",
       NumberKey{at(&P::resin, &P::Resin::hole_growth_mm), -1, 1}, Written::UnlessDefault},
      {"supports", "self_support_mm", false,
       "overhang per layer that a small attached region holds; less: more anchors; 0: by bending, from strength, pull, "
       "dose and depth",
       NumberKey{at(&P::supports, &P::Supports::self_support_mm), 0, 10}},
      {"supports", "self_support_growth_per_mm", false, "growth of that per sqrt of the attached area",
       NumberKey{at(&P::supports, &P::Supports::self_support_growth_per_mm), 0, 1000}},
      {"supports", "self_support_most_mm", false, "no attached region holds an overhang beyond this in one layer",
       NumberKey{at(&P::supports, &P::Supports::self_support_most_mm), 0, 50}},
      {"supports", "anchor_distance_mm", false, "every point to be supported lies this near an anchor",
       NumberKey{at(&P::supports, &P::Supports::anchor_distance_mm), 0.05, 50}},
      {"supports", "tip_radius_mm", false, "contact disc; smaller breaks off cleaner, below a pixel it may not cure",
       NumberKey{at(&P::supports, &P::Supports::tip_radius_mm), 0.005, 5}},
      {"supports", "pin_radius_mm", false, "shaft of a pin; thinner saves resin and gets more braces",
       NumberKey{at(&P::supports, &P::Supports::pin_radius_mm), 0.01, 10}},
      {"supports", "foot_radius_mm", false, "footing of a pin on the platform; wider holds against the peel",
       NumberKey{at(&P::supports, &P::Supports::foot_radius_mm), 0.01, 20}},
      {"supports", "clearance_mm", false, "between supports and part except at tips and feet",
       NumberKey{at(&P::supports, &P::Supports::clearance_mm), 0, 10}},
      {"supports", "brace_pitch_mm", false,
       "vertical distance of slanted struts between pins that are too slender alone",
       NumberKey{at(&P::supports, &P::Supports::brace_pitch_mm), 0.1, 200}},
      {"supports", "slenderness", false, "free pin length over diameter at most",
       NumberKey{at(&P::supports, &P::Supports::slenderness), 2, 500}},
      {"supports", "base_thickness_mm", false,
       "plate that joins the feet of a group, so that the peel does not lift one",
       NumberKey{at(&P::supports, &P::Supports::base_thickness_mm), 0, 10}},
      {"supports", "stand_area_share", false, "a first layer of at least this share of the largest needs no lift",
       NumberKey{at(&P::supports, &P::Supports::stand_area_share), 0, 1}},
      {"supports", "lift_off_mm", false, "height of a supported part above the platform: room for tips and a blade",
       NumberKey{at(&P::supports, &P::Supports::lift_off_mm), 0, 50}},
      {"supports", "safety", false, "strength over the stress that a plan may ask for; 2 is assumed",
       NumberKey{at(&P::supports, &P::Supports::safety), 1, 100}},
      {"supports", "fresh_share", false,
       "strength of a tip some seconds after its exposure as share of the green strength; 0.5 is assumed: with it a "
       "plan may ask for what PrusaSlicer's plans ask for",
       NumberKey{at(&P::supports, &P::Supports::fresh_share), 0.01, 1}},
      {"supports", "overhang_share", false,
       "strength of one layer's overhang over that of a full section as thick as the layer; `calibrate supports` finds "
       "it; 0: computed from dose and depth, for a strength that rises with dose as assumed",
       NumberKey{at(&P::supports, &P::Supports::overhang_share), 0, 100}, Written::UnlessDefault},
      {"supports", "medium_tip_radius_mm", false, "tips where light ones bear too much; 0: 1.5 times tip_radius_mm",
       NumberKey{at(&P::supports, &P::Supports::medium_tip_radius_mm), 0, 5}, Written::UnlessDefault},
      {"supports", "heavy_tip_radius_mm", false, "tips where those do; 0: twice tip_radius_mm",
       NumberKey{at(&P::supports, &P::Supports::heavy_tip_radius_mm), 0, 5}, Written::UnlessDefault},
      {"supports", "tip_depth_mm", false, "how far tips go into the part; 0: by their radius, a layer at least",
       NumberKey{at(&P::supports, &P::Supports::tip_depth_mm), 0, 5}, Written::UnlessDefault},
      {"supports", "arm_degrees", false, "most lean of the arm between pin and tip, from upright",
       NumberKey{at(&P::supports, &P::Supports::arm_degrees), 5, 70}, Written::UnlessDefault},
      {"supports", "density", false, "so many times the anchors that would do",
       NumberKey{at(&P::supports, &P::Supports::density), 0.25, 4}, Written::UnlessDefault},
      {"supports", "ground", false, "where pins may stand: a pin on the part marks it twice",
       words(&P::supports, &P::Supports::ground), Written::UnlessDefault},
      {"supports", "raft", false,
       "what joins the feet: bars between neighbours (plates), one plate under all, a wide disc each (skate), nothing; "
       "auto: bars beside a part that stands, a plate for each group of feet under a lifted one, or one under all "
       "where "
       "those cover less than a fifth of the largest layer",
       words(&P::supports, &P::Supports::raft), Written::UnlessDefault},
      {"supports", "raft_margin_mm", false, "of one plate, and of a skate's discs, beyond the feet",
       NumberKey{at(&P::supports, &P::Supports::raft_margin_mm), 0, 20}, Written::UnlessDefault},
      {"supports", "raft_lip_degrees", false, "how far the lower edge of plates recedes from upright, for a scraper",
       NumberKey{at(&P::supports, &P::Supports::raft_lip_degrees), 0, 60}, Written::UnlessDefault},
      {"motion", "lift_mm", false, "up by this after each exposure; 0 where the vat tips instead",
       NumberKey{at(&P::motion, &P::Motion::lift_mm), 0, 100}},
      {"motion", "lift_speed_mm_per_s", false, "while lifting",
       NumberKey{at(&P::motion, &P::Motion::lift_speed_mm_per_s), 0.01, 100}},
      {"motion", "lower_speed_mm_per_s", false, "back to the vat",
       NumberKey{at(&P::motion, &P::Motion::lower_speed_mm_per_s), 0.01, 100}},
      {"motion", "settle_s", false, "lowered, before the exposure: resin comes to rest",
       NumberKey{at(&P::motion, &P::Motion::settle_s), 0, 120}},
      {"motion", "pull_kpa", false,
       "pull of the film on the layer just exposed, over its area; measured elsewhere: ACF 12, FEP 12 to 18 "
       "(AmeraLabs), PDMS 16 to 20 (Pan 2017); 0: not stated, then 20 is assumed; 10 where a gentle film or a tilt was "
       "measured to be so, 50 for a worn or rigid window; printed from above: 1, assumed",
       NumberKey{at(&P::motion, &P::Motion::pull_kpa), 0, 1000}},
      {"motion", "pull_size_mm", false,
       "area over perimeter of a layer on which the pull is twice that of a small one: pull * (1 + (A / L) / this); "
       "7.4 "
       "fits what Pan 2017 measured on PDMS; 0: the pull does not grow with size",
       NumberKey{at(&P::motion, &P::Motion::pull_size_mm), 0, 1000}, Written::UnlessDefault},
      {"motion", "pull_speed_mm_per_s", false,
       "speed of the lift, or of its peel, at which the film comes off with that pull; 0: speed does not matter",
       NumberKey{at(&P::motion, &P::Motion::pull_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "pull_speed_power", false,
       "the pull grows with the speed to this power; measured elsewhere: FEP 0.18, PDMS 0.75 to 0.9 (Pan 2017)",
       NumberKey{at(&P::motion, &P::Motion::pull_speed_power), 0, 2}, Written::UnlessDefault},
      {"motion", "vacuum_kpa", false,
       "under the opening of a hollow that the film closes when it is lifted; 0: not stated, then 2.5 times the pull "
       "is "
       "assumed, 50 beside 20; more than 101 counts as 101",
       NumberKey{at(&P::motion, &P::Motion::vacuum_kpa), 0, 101}, Written::UnlessDefault},
      {"motion", "push_kpa", false,
       "sideways push on the layer just exposed, over its area, in any direction; 0 where a film is peeled; printed "
       "from above with a blade or a dip: 0.5, assumed",
       NumberKey{at(&P::motion, &P::Motion::push_kpa), 0, 1000}},
      {"motion", "most_speed_mm_per_s", false, "no speed of this printer's stage is above; 0: not stated",
       NumberKey{at(&P::motion, &P::Motion::most_speed_mm_per_s), 0, 1000}, Written::UnlessDefault},
      {"motion", "peel_mm", false, "first part of the lift, slow, while the film comes off; 0: none",
       NumberKey{at(&P::motion, &P::Motion::peel_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "peel_speed_mm_per_s", false, "in that part; must be stated where there is one",
       NumberKey{at(&P::motion, &P::Motion::peel_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "approach_mm", false, "last part of the lowering, slow, while resin is pressed out; 0: none",
       NumberKey{at(&P::motion, &P::Motion::approach_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "approach_speed_mm_per_s", false, "in that part; must be stated where there is one",
       NumberKey{at(&P::motion, &P::Motion::approach_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "wait_after_exposure_s", false, "dark and at rest before the lift",
       NumberKey{at(&P::motion, &P::Motion::wait_after_exposure_s), 0, 600}, Written::UnlessDefault},
      {"motion", "wait_after_lift_s", false, "on top of the lift: resin flows back under the part",
       NumberKey{at(&P::motion, &P::Motion::wait_after_lift_s), 0, 600}, Written::UnlessDefault},
      {"motion", "tilt_s", false,
       "the vat tips down and up again before the lift, in so long; 0: it does not tip. SL1 archives have it as their "
       "fast tilt",
       NumberKey{at(&P::motion, &P::Motion::tilt_s), 0, 120}, Written::UnlessDefault},
      {"motion", "acceleration_mm_per_s2", false,
       "of the axis, for estimates: $122 of GRBL, M201 Z of Marlin; 0: not stated, then speeds are taken as reached at "
       "once",
       NumberKey{at(&P::motion, &P::Motion::acceleration_mm_per_s2), 0, 100000}, Written::UnlessDefault},
      {"motion", "homing_speed_mm_per_s", false,
       "for estimates and deadlines: $25 of GRBL over 60; 0: not stated, then 2 is assumed, 20 of a virtual stage",
       NumberKey{at(&P::motion, &P::Motion::homing_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "large_area_mm2", false, "layers that light more move by the large_ keys; 0: none does",
       NumberKey{at(&P::motion, &P::Motion::large_area_mm2), 0, 1e7}, Written::UnlessDefault},
      {"motion", "large_lift_mm", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::lift_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "large_lift_speed_mm_per_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::lift_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "large_peel_mm", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::peel_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "large_peel_speed_mm_per_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::peel_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "large_lower_speed_mm_per_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::lower_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "large_approach_mm", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::approach_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "large_approach_speed_mm_per_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::approach_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "large_settle_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::settle_s), 0, 120}, Written::UnlessDefault},
      {"motion", "large_wait_after_exposure_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::wait_after_exposure_s), 0, 600}, Written::UnlessDefault},
      {"motion", "large_wait_after_lift_s", false, "of layers above large_area_mm2; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::wait_after_lift_s), 0, 600}, Written::UnlessDefault},
      {"motion", "large_tilt_s", false,
       "of layers above large_area_mm2, the slow tilt of SL1 archives; 0: as the others",
       NumberKey{at(&P::Motion::large, &P::Stroke::tilt_s), 0, 120}, Written::UnlessDefault},
      {"motion", "bottom_lift_mm", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::lift_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_lift_speed_mm_per_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::lift_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_peel_mm", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::peel_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_peel_speed_mm_per_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::peel_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_lower_speed_mm_per_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::lower_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_approach_mm", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::approach_mm), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_approach_speed_mm_per_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::approach_speed_mm_per_s), 0, 100}, Written::UnlessDefault},
      {"motion", "bottom_settle_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::settle_s), 0, 120}, Written::UnlessDefault},
      {"motion", "bottom_wait_after_exposure_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::wait_after_exposure_s), 0, 600}, Written::UnlessDefault},
      {"motion", "bottom_wait_after_lift_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::wait_after_lift_s), 0, 600}, Written::UnlessDefault},
      {"motion", "bottom_tilt_s", false, "of the bottom layers; 0: as the others",
       NumberKey{at(&P::Motion::bottom, &P::Stroke::tilt_s), 0, 120}, Written::UnlessDefault},
      {"devices", "projector", false, "light engine", words(&P::devices, &P::Devices::projector)},
      {"devices", "stage", false, "Z stage", words(&P::devices, &P::Devices::stage)},
      {"devices", "light", false, "who switches the light and times it; stage: the projector only shows the mask",
       words(&P::devices, &P::Devices::light), Written::UnlessDefault},
      {"devices", "speed_up", false, "virtual devices: simulated seconds per real second",
       NumberKey{at(&P::devices, &P::Devices::speed_up), 1, 1e6}},
      {"devices", "allowed_slowdown", false, "a job whose uploads stretch it beyond this is refused",
       NumberKey{at(&P::devices, &P::Devices::allowed_slowdown), 1, 100}},
      {"devices", "led_current", false, "dlpc900: never sent above",
       CountKey{at(&P::devices, &P::Devices::led_current), 0, 255}},
      {"devices", "led_colour", false, "dlpc900", words(&P::devices, &P::Devices::led_colour)},
      {"devices", "led_polarity", false, "dlpc900: PWM polarity under which more current is more light on this board",
       words(&P::devices, &P::Devices::led_polarity)},
      {"devices", "led_off", false, "dlpc900: what darkens the LEDs of this board",
       words(&P::devices, &P::Devices::led_off)},
      {"devices", "led_cutoff", false,
       "dlpc900 with led_off = \"enable-and-current\", and a screen whose lamp is always on: what darkens it where "
       "this "
       "computer dies",
       words(&P::devices, &P::Devices::led_cutoff)},
      {"devices", "thermometer", false, "marlin: the sensor that is in the resin",
       words(&P::devices, &P::Devices::thermometer)},
      {"devices", "hottest_celsius", false, "resin above this stops the print, dark; 0: no limit",
       NumberKey{at(&P::devices, &P::Devices::hottest_celsius), 0, 150}},
      {"devices", "coldest_celsius", false, "resin below this stops the print, dark; 0: no limit",
       NumberKey{at(&P::devices, &P::Devices::coldest_celsius), 0, 150}},
      {"devices", "projector_serial", false, "dlpc900: its USB serial number",
       TextKey{at(&P::devices, &P::Devices::projector_serial)}},
      {"devices", "stage_serial", false, "USB serial number of the stage's tty",
       TextKey{at(&P::devices, &P::Devices::stage_serial)}},
      {"screen", "connector", false,
       "the connector, as HDMI-A-1 (probe lists what there is); or the path of a framebuffer, as /dev/fb0, or of a "
       "file",
       TextKey{at(&P::screen, &P::Screen::connector)}, Written::UnlessDefault},
      {"screen", "edid", false,
       "who the screen must be: maker, product, serial number and name as probe prints them; none: it gives no EDID",
       TextKey{at(&P::screen, &P::Screen::edid)}, Written::UnlessDefault},
      {"screen", "width_px", false, "words of its mode across; of a packed panel a third of its pixels",
       CountKey{at(&P::screen, &P::Screen::width_px), 0, 16384}, Written::UnlessDefault},
      {"screen", "height_px", false, "rows of its mode", CountKey{at(&P::screen, &P::Screen::height_px), 0, 16384},
       Written::UnlessDefault},
      {"screen", "refresh_hz", false, "of its mode; 0 for a framebuffer, which states none",
       NumberKey{at(&P::screen, &P::Screen::refresh_hz), 0, 500}, Written::UnlessDefault},
      {"screen", "rotation", false, "degrees clockwise by which a mask is turned to stand upright on the panel",
       words(&P::screen, &P::Screen::rotation), Written::UnlessDefault},
      {"screen", "packing", false,
       "how grey pixels stand in its words: one in all colours, or three in one, the first in red (rgb), in blue "
       "(bgr), "
       "in the high bits (5-6-5, 5-5-5: fewer greys)",
       words(&P::screen, &P::Screen::packing), Written::UnlessDefault},
      {"screen", "latency_frames", false, "from a flip that is confirmed to a picture that stands on the panel",
       CountKey{at(&P::screen, &P::Screen::latency_frames), 0, 60}, Written::UnlessDefault},
      {"light", "command", false, "by what the stage's board switches it: grbl spindle, marlin fan or pin",
       words(&P::light, &P::Light::command), Written::UnlessDefault},
      {"light", "number", false, "marlin: of the fan or the pin", CountKey{at(&P::light, &P::Light::number), 0, 255},
       Written::UnlessDefault},
      {"light", "power", false, "what is full light, as share of the board's full PWM; nothing above is ever sent",
       NumberKey{at(&P::light, &P::Light::power), 0.01, 1}, Written::UnlessDefault},
      {"light", "steps", false, "equal steps from dark to full; 1: it is not dimmed",
       CountKey{at(&P::light, &P::Light::steps), 1, 1000}, Written::UnlessDefault},
      {"light", "packet_bytes", false,
       "that the board's USB adapter carries whole: 32 of a CH340, 64 of CDC and FTDI; an exposure is sent in one",
       CountKey{at(&P::light, &P::Light::packet_bytes), 32, 64}, Written::UnlessDefault},
  };
  return table;
}

std::string range_of(const Key& key) {
  if (const auto* n = std::get_if<NumberKey>(&key.kind)) return fmt::format("{} to {}", n->least, n->most);
  if (const auto* c = std::get_if<CountKey>(&key.kind)) return fmt::format("{} to {}, whole", c->least, c->most);
  if (std::holds_alternative<CurveKey>(key.kind))
    return fmt::format("2 to {} numbers that never fall, the first 0, the last 1; or none", kMostCurve);
  if (const auto* g = std::get_if<GridKey>(&key.kind))
    return fmt::format("up to {0} rows of equal length up to {0}, numbers {1} to {2}; or none", kMostGridSide, g->least,
                       g->most);
  if (const auto* w = std::get_if<WordKey>(&key.kind)) return fmt::format("{}", fmt::join(w->all, " | "));
  return "text";
}

std::string describe_keys() {
  std::string text;
  for (const Key& key : profile_keys())
    text += fmt::format("{}.{}{}: {} ({})\n", key.section, key.name, key.required ? " (required)" : "", key.reason,
                        range_of(key));
  return text;
}

}  // namespace telefab
