// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

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

}  // namespace

Result<void> PrintPlan::validate() const {
  if (layers.empty()) return fail(ErrorCode::InvalidInput, "the plan has no layer");
  if (mask_size.width_px == 0 || mask_size.height_px == 0)
    return fail(ErrorCode::InvalidInput, "the plan's masks have no pixels");
  const auto positive = [](double v) { return std::isfinite(v) && v > 0; };
  if (!positive(motion.lift_mm) || !positive(motion.lift_speed_mm_per_s) || !positive(motion.lower_speed_mm_per_s))
    return fail(ErrorCode::InvalidInput, "the plan's lift and its speeds must be positive and finite");
  if (!(motion.settle_s >= 0) || !std::isfinite(motion.settle_s))
    return fail(ErrorCode::InvalidInput, "the plan's settling time must be finite and not negative");
  if (!positive(z_travel_mm)) return fail(ErrorCode::InvalidInput, "the plan's travel must be positive and finite");
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
    below_mm = layer.z_mm;
  }
  return {};
}

double layer_seconds(const MachineProfile::Motion& motion, std::chrono::microseconds exposure) {
  return std::chrono::duration<double>(exposure).count() + motion.lift_mm / motion.lift_speed_mm_per_s +
         motion.lift_mm / motion.lower_speed_mm_per_s + motion.settle_s;
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
  Json layers = Json::array();
  for (const PlannedLayer& l : plan.layers)
    layers.push_back(Json{{"layer", l.index.count()},
                          {"z_mm", l.z_mm},
                          {"exposure_us", l.exposure.count()},
                          {"mask_sha256", to_hex(l.mask)}});
  Json j{{"format", "telefab-print-plan-1"}, {"job", plan.job}, {"machine", plan.machine}};
  if (plan.masks) j["masks"] = name_of(*plan.masks);
  j.update({{"mask_width_px", plan.mask_size.width_px},
            {"mask_height_px", plan.mask_size.height_px},
            {"z_travel_mm", plan.z_travel_mm},
            {"lift_mm", plan.motion.lift_mm},
            {"lift_speed_mm_per_s", plan.motion.lift_speed_mm_per_s},
            {"lower_speed_mm_per_s", plan.motion.lower_speed_mm_per_s},
            {"settle_s", plan.motion.settle_s},
            {"layers", std::move(layers)}});
  if (plan.profile != Digest{}) j["profile_sha256"] = to_hex(plan.profile);  // plans of 0.1 keep their bytes
  return json_text(j, 1) + "\n";
}

Result<PrintPlan> print_plan_from_json(std::string_view text) {
  try {
    const auto j = parsed_json(text);
    if (j.at("format") != "telefab-print-plan-1")
      return fail(ErrorCode::InvalidInput, "the print plan's format is not telefab-print-plan-1");
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
    plan.motion = {j.at("lift_mm").get<double>(), j.at("lift_speed_mm_per_s").get<double>(),
                   j.at("lower_speed_mm_per_s").get<double>(), j.at("settle_s").get<double>()};
    for (const auto& l : j.at("layers")) {
      const auto mask = digest_from_hex(l.at("mask_sha256").get<std::string>());
      if (!mask) return fail_in("print plan, mask_sha256", mask.error());
      plan.layers.push_back({LayerIndex{whole_number<std::uint32_t>(l.at("layer"))}, l.at("z_mm").get<double>(),
                             std::chrono::microseconds{whole_number<std::int64_t>(l.at("exposure_us"))}, *mask});
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
