// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/cure/dose_field.hpp>
#include <telefab/fab/planning/cured_runs.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint8_t kSolid = 255, kJoined = 128;  // grey levels that mark a pixel's state while runs are made
constexpr double kJoinedDepth = 0.125;               // of a layer's thickness: solid so deep, neighbours hang together

struct Levels {
  double solid = 0;   ///< dose that cures a layer to its middle
  double joined = 0;  ///< dose that cures it to kJoinedDepth
  [[nodiscard]] std::uint8_t operator()(double dose) const {
    return dose >= solid ? kSolid : dose >= joined ? kJoined : std::uint8_t{0};
  }
};

/// The state of one pixel. The blur is a mean of what is around: only where neighbours differ does it decide.
std::uint8_t state_of(const DoseField& dose, const Levels& level_of, int x, int y) {
  const std::uint8_t level = level_of(static_cast<double>(dose.pixel(x, y)));
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j)
      if (level_of(static_cast<double>(dose.pixel(x + j, y + i))) != level || level == kJoined)
        return level_of(dose.sample({x + 0.5, y + 0.5}).dose);
  return level;
}

/// Overwrites the mask with the states of its pixels.
void draw_states(const DoseField& dose, const Levels& levels, Mask& mask) {
  std::fill(mask.rows.begin(), mask.rows.end(), std::uint8_t{0});
  const PixelBox& box = dose.box();
  const int width = static_cast<int>(mask.size.width_px), height = static_cast<int>(mask.size.height_px);
  for (int y = std::max(0, box.y); y < std::min(height, box.y + box.height); ++y) {
    std::uint8_t* row = mask.rows.data() + static_cast<std::ptrdiff_t>(height - 1 - y) * width;
    for (int x = std::max(0, box.x); x < std::min(width, box.x + box.width); ++x) row[x] = state_of(dose, levels, x, y);
  }
}

double seconds_of(const PlannedLayer& layer) {
  return std::chrono::duration<double>(layer.exposure_at_full_light()).count();
}

/// The machine with the normal exposure of the plan at full light, which may have been made for a cure depth.
MachineProfile exposed_as(const MachineProfile& profile, const PrintPlan& plan) {
  const MachineProfile stated = profile.at_full_light();
  MachineProfile machine = stated;
  for (const PlannedLayer& layer : plan.layers) {
    if (layer.exposure.count() == 0) continue;
    const std::uint32_t index = layer.index.count();
    machine.layers.exposure_s = seconds_of(layer) * stated.layers.exposure_s / stated.exposure_of_layer_s(index);
    if (index >= stated.layers.bottom_count + stated.layers.transition_count) break;
  }
  return machine;
}

Result<MaskMethod> method_of(const PrintPlan& plan, const std::optional<MaskMethod>& stated) {
  if (plan.masks && stated && *plan.masks != *stated)
    return fail(ErrorCode::InvalidInput, fmt::format("the plan says that its masks were made by {}, not by {}",
                                                     name_of(*plan.masks), name_of(*stated)));
  if (plan.masks) return *plan.masks;
  if (stated) return *stated;
  return fail(ErrorCode::InvalidInput,
              "the plan is of a version that did not say how its masks were made; say it by --masks, or plan the job "
              "again");
}

Result<SupportReport> check_by_all_light(const PrintPlan& plan, MaskSource& masks, const MachineProfile& machine,
                                         MaskWatch watch, const ProgressSink& progress, const std::stop_token& stop) {
  auto runs = cured_runs(plan, masks, machine, progress, stop);
  if (!runs) return tl::unexpected{runs.error()};
  for (CuredRuns& layer : *runs)
    if (auto ok = watch.add(std::move(layer.solid), nullptr, &layer.light); !ok) return tl::unexpected{ok.error()};
  return watch.finish();
}

Result<SupportReport> check_by_level(const PrintPlan& plan, MaskSource& masks, std::uint8_t level, MaskWatch watch,
                                     const ProgressSink& progress, const std::stop_token& stop) {
  const auto count = static_cast<double>(plan.layers.size());
  for (const PlannedLayer& layer : plan.layers) {
    if (stop.stop_requested()) return cancelled("checking the masks");
    const auto mask = masks.mask(layer.index);
    if (!mask) return tl::unexpected{mask.error()};
    if (auto ok = watch.add(LayerRuns::from_mask(mask->view(), level)); !ok) return tl::unexpected{ok.error()};
    report(progress, WorkStage::CheckingMasks, (layer.index.count() + 1) / count);
  }
  return watch.finish();
}

}  // namespace

Result<std::vector<CuredRuns>> cured_runs(const PrintPlan& plan, MaskSource& masks, const MachineProfile& machine,
                                          const ProgressSink& progress, const std::stop_token& stop) {
  const auto model = cure_model(machine);
  if (!model) return tl::unexpected{model.error()};
  DoseStream light{*model};
  const Levels levels{model->to_middle(), std::exp(kJoinedDepth * model->layer_mm / model->penetration_mm)};
  const std::size_t count = plan.layers.size();
  std::vector<CuredRuns> runs(count);
  for (std::size_t k = count; k-- > 0;) {
    if (stop.stop_requested()) return cancelled("checking the masks");
    const PlannedLayer& layer = plan.layers[k];
    auto mask = masks.mask(layer.index);
    if (!mask) return tl::unexpected{mask.error()};
    const MaskExposure exposure{mask->view(), layer.exposure_at_full_light()};
    const auto dose = light.descend({&exposure, 1});
    if (!dose) return tl::unexpected{dose.error()};
    runs[k].light.lit = LayerRuns::from_mask(mask->view(), gel_level(machine, seconds_of(layer)));
    draw_states(*dose, levels, *mask);
    runs[k].solid = LayerRuns::from_mask(mask->view(), kSolid);
    runs[k].light.joined = LayerRuns::from_mask(mask->view(), kJoined);
    report(progress, WorkStage::CheckingLight, static_cast<double>(count - k) / static_cast<double>(count));
  }
  return runs;
}

Result<SupportReport> check_masks(const PrintPlan& plan, MaskSource& masks, const MachineProfile& machine,
                                  const MaskCheckOptions& options, const ProgressSink& progress,
                                  const std::stop_token& stop) {
  MaskWatch watch{machine.projection.pixel_pitch_mm, options.least_pixels};
  if (options.grey) return check_by_level(plan, masks, *options.grey, std::move(watch), progress, stop);
  const auto method = method_of(plan, options.masks);
  if (!method) return tl::unexpected{method.error()};
  if (*method == MaskMethod::BlendStack)
    return check_by_all_light(plan, masks, machine, std::move(watch), progress, stop);
  return check_by_level(plan, masks, cure_level(exposed_as(machine, plan)), std::move(watch), progress, stop);
}

}  // namespace telefab::fab
