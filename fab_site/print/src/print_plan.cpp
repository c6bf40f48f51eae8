// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/machine/profile_digest.hpp>

namespace telefab::fab {

using Json = nlohmann::ordered_json;

namespace {

constexpr double kHeightTolerance_mm = 1e-9;
constexpr std::chrono::microseconds kLongestExposure = std::chrono::hours{1};

tl::unexpected<Error> bad(const PlannedLayer& layer, std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("layer {} of the plan: {}", layer.index.count(), what));
}

/// What telefab-print-plan-1 can say of the motion: one lift, two speeds and a rest for all layers.
bool is_plain(const PrintPlan& plan) {
  LayerMotion plain;
  if (!plan.layers.empty()) {
    const LayerMotion& m = plan.layers.front().motion;
    plain.lift_mm = m.lift_mm;
    plain.lift_speed_mm_per_s = m.lift_speed_mm_per_s;
    plain.lower_speed_mm_per_s = m.lower_speed_mm_per_s;
    plain.settle_s = m.settle_s;
  }
  return plan.acceleration_mm_per_s2 == 0 && std::all_of(plan.layers.begin(), plan.layers.end(), [&](const auto& l) {
           return l.motion == plain && l.light_share == 1;
         });
}

struct MotionKey {
  const char* name;
  double LayerMotion::*value;
};
/// Of an entry of "motions" in telefab-print-plan-2.
constexpr std::array kMotionKeys{
    MotionKey{"lower_speed_mm_per_s", &LayerMotion::lower_speed_mm_per_s},
    MotionKey{"approach_mm", &LayerMotion::approach_mm},
    MotionKey{"approach_speed_mm_per_s", &LayerMotion::approach_speed_mm_per_s},
    MotionKey{"settle_s", &LayerMotion::settle_s},
    MotionKey{"wait_after_exposure_s", &LayerMotion::wait_after_exposure_s},
    MotionKey{"tilt_s", &LayerMotion::tilt_s},
    MotionKey{"peel_mm", &LayerMotion::peel_mm},
    MotionKey{"peel_speed_mm_per_s", &LayerMotion::peel_speed_mm_per_s},
    MotionKey{"lift_mm", &LayerMotion::lift_mm},
    MotionKey{"lift_speed_mm_per_s", &LayerMotion::lift_speed_mm_per_s},
    MotionKey{"wait_after_lift_s", &LayerMotion::wait_after_lift_s},
};
static_assert(sizeof(LayerMotion) == kMotionKeys.size() * sizeof(double), "a member of LayerMotion has no key");

Json json_of(const LayerMotion& motion) {
  Json j;
  for (const MotionKey& key : kMotionKeys) j[key.name] = motion.*key.value;
  return j;
}

/// Different motions in the order in which layers have them first.
std::vector<LayerMotion> motions_of(const PrintPlan& plan) {
  std::vector<LayerMotion> motions;
  for (const PlannedLayer& layer : plan.layers)
    if (std::find(motions.begin(), motions.end(), layer.motion) == motions.end()) motions.push_back(layer.motion);
  return motions;
}

constexpr std::string_view kPlain = "telefab-print-plan-1", kPerLayer = "telefab-print-plan-2";

}  // namespace

Result<void> PrintPlan::validate() const {
  if (layers.empty()) return fail(ErrorCode::InvalidInput, "the plan has no layer");
  if (mask_size.width_px == 0 || mask_size.height_px == 0)
    return fail(ErrorCode::InvalidInput, "the plan's masks have no pixels");
  if (!std::isfinite(z_travel_mm) || z_travel_mm <= 0)
    return fail(ErrorCode::InvalidInput, "the plan's travel must be positive and finite");
  if (!std::isfinite(acceleration_mm_per_s2) || acceleration_mm_per_s2 < 0)
    return fail(ErrorCode::InvalidInput, "the plan's acceleration must be finite and not negative");
  double below_mm = 0;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const PlannedLayer& layer = layers[i];
    if (layer.index.count() != i) return bad(layer, fmt::format("stands in place {}", i));
    if (!std::isfinite(layer.z_mm) || layer.z_mm <= below_mm)
      return bad(layer, fmt::format("its z of {} mm is not above the layer below", layer.z_mm));
    if (layer.z_mm > z_travel_mm + kHeightTolerance_mm)
      return bad(layer, fmt::format("its z of {} mm is beyond the travel of {} mm", layer.z_mm, z_travel_mm));
    if (layer.exposure.count() < 0 || layer.exposure > kLongestExposure)
      return bad(layer, fmt::format("its exposure of {} us is not within 0 and one hour", layer.exposure.count()));
    if (!(layer.light_share > 0 && layer.light_share <= 1))
      return bad(layer, fmt::format("its share of the light of {} is not above 0 and up to 1", layer.light_share));
    if (const auto ok = layer.motion.validate(); !ok) return bad(layer, ok.error().what);
    below_mm = layer.z_mm;
  }
  return {};
}

Result<void> PrintPlan::fits(const MachineProfile& now) const {
  if (profile == digest_of_light(now)) return {};
  if (profile == Digest{})
    return fail(ErrorCode::Conflict,
                fmt::format("the plan does not say which profile of {} it was made for; plan the job again", machine));
  return fail(ErrorCode::Conflict, fmt::format("the profile of {} was changed since the job was planned, so its masks "
                                               "and exposures no longer hold: put the profile back, or submit the job "
                                               "again",
                                               machine));
}

std::string to_json(const PrintPlan& plan) {
  const bool plain = is_plain(plan);
  const std::vector<LayerMotion> motions = motions_of(plan);
  Json layers = Json::array();
  for (const PlannedLayer& l : plan.layers) {
    Json layer{{"layer", l.index.count()},
               {"z_mm", l.z_mm},
               {"exposure_us", l.exposure.count()},
               {"mask_sha256", to_hex(l.mask)}};
    if (!plain) {
      layer["motion"] = std::find(motions.begin(), motions.end(), l.motion) - motions.begin();
      layer["light_share"] = l.light_share;
    }
    layers.push_back(std::move(layer));
  }
  Json j{{"format", plain ? kPlain : kPerLayer}, {"job", plan.job}, {"machine", plan.machine}};
  if (plan.masks) j["masks"] = name_of(*plan.masks);
  j.update({{"mask_width_px", plan.mask_size.width_px},
            {"mask_height_px", plan.mask_size.height_px},
            {"z_travel_mm", plan.z_travel_mm}});
  if (plain) {
    const LayerMotion motion = motions.empty() ? LayerMotion{} : motions.front();
    j.update({{"lift_mm", motion.lift_mm},
              {"lift_speed_mm_per_s", motion.lift_speed_mm_per_s},
              {"lower_speed_mm_per_s", motion.lower_speed_mm_per_s},
              {"settle_s", motion.settle_s}});
  } else {
    j["acceleration_mm_per_s2"] = plan.acceleration_mm_per_s2;
    j["motions"] = Json::array();
    for (const LayerMotion& motion : motions) j["motions"].push_back(json_of(motion));
  }
  j["layers"] = std::move(layers);
  if (plan.profile != Digest{}) j["profile_sha256"] = to_hex(plan.profile);  // plans of 0.1 keep their bytes
  return json_text(j, 1) + "\n";
}

Result<PrintPlan> print_plan_from_json(std::string_view text) {
  try {
    const auto j = parsed_json(text);
    const auto format = j.at("format").get<std::string>();
    if (format != kPlain && format != kPerLayer)
      return fail(ErrorCode::InvalidInput, fmt::format("the print plan's format is {}, neither {} nor {}; plan the job "
                                                       "again, or with the version that wrote it",
                                                       format, kPlain, kPerLayer));
    PrintPlan plan;
    plan.job = j.at("job").get<std::string>();
    plan.machine = j.at("machine").get<std::string>();
    if (j.contains("masks")) {
      const auto masks = mask_method_from_name(j.at("masks").get<std::string>());
      if (!masks) return fail_in("print plan, masks", masks.error());
      plan.masks = *masks;
    }
    if (j.contains("profile_sha256")) {
      const auto profile = digest_from_hex(j.at("profile_sha256").get<std::string>());
      if (!profile) return fail_in("print plan, profile_sha256", profile.error());
      plan.profile = *profile;
    }
    plan.mask_size = {whole_number<std::uint32_t>(j.at("mask_width_px")),
                      whole_number<std::uint32_t>(j.at("mask_height_px"))};
    plan.z_travel_mm = j.at("z_travel_mm").get<double>();
    std::vector<LayerMotion> motions;
    if (format == kPlain) {
      LayerMotion& motion = motions.emplace_back();
      motion.lift_mm = j.at("lift_mm").get<double>();
      motion.lift_speed_mm_per_s = j.at("lift_speed_mm_per_s").get<double>();
      motion.lower_speed_mm_per_s = j.at("lower_speed_mm_per_s").get<double>();
      motion.settle_s = j.at("settle_s").get<double>();
    } else {
      plan.acceleration_mm_per_s2 = j.at("acceleration_mm_per_s2").get<double>();
      for (const auto& m : j.at("motions")) {
        LayerMotion& motion = motions.emplace_back();
        for (const MotionKey& key : kMotionKeys) motion.*key.value = m.at(key.name).get<double>();
      }
    }
    for (const auto& l : j.at("layers")) {
      const auto mask = digest_from_hex(l.at("mask_sha256").get<std::string>());
      if (!mask) return fail_in("print plan, mask_sha256", mask.error());
      const auto motion = format == kPlain ? 0 : whole_number<std::uint32_t>(l.at("motion"));
      if (motion >= motions.size())
        return fail(ErrorCode::InvalidInput,
                    fmt::format("a layer of the print plan has motion {} of {}", motion, motions.size()));
      plan.layers.push_back({LayerIndex{whole_number<std::uint32_t>(l.at("layer"))}, l.at("z_mm").get<double>(),
                             std::chrono::microseconds{whole_number<std::int64_t>(l.at("exposure_us"))}, *mask,
                             motions[motion], format == kPlain ? 1 : l.at("light_share").get<double>()});
    }
    if (const auto ok = plan.validate(); !ok) return tl::unexpected{ok.error()};
    return plan;
  } catch (const nlohmann::ordered_json::exception& e) {
    return fail(ErrorCode::InvalidInput, std::string{"the print plan is not as expected: "} + e.what());
  }
}

Digest plan_digest(const PrintPlan& plan) {
  const std::string text = to_json(plan);
  return digest_of(std::as_bytes(std::span{text}));
}

}  // namespace telefab::fab
