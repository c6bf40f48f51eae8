// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/print/admission.hpp>
#include <telefab/fab/print/print_time.hpp>

namespace telefab::fab {

namespace {

double seconds(Nanoseconds t) { return double(t.count()) * 1e-9; }

}  // namespace

Result<Admission> estimate_print(const PrintPlan& plan, LayerIndex from, MaskSource& masks, const Projector& projector,
                                 const ZStage& stage, const ProgressSink& progress, std::stop_token stop) {
  Admission a;
  std::vector<Nanoseconds> upload(plan.layers.size());
  for (std::size_t k = from.count(); k < plan.layers.size(); ++k) {
    if (stop.stop_requested()) return cancelled("estimating the print");
    const PlannedLayer& layer = plan.layers[k];
    if (layer.exposure.count() == 0) continue;
    if (layer.exposure < projector.facts().shortest_exposure && !a.has_too_short) {
      a.has_too_short = true;
      a.too_short = layer.index;
    }
    if (const auto step = light_step(layer.light_share, projector.facts().light_steps); !step)
      return fail_in(fmt::format("layer {}", k), step.error());
    const auto mask = masks.mask(layer.index);
    if (!mask) return fail_in(fmt::format("mask of layer {}", k), mask.error());
    if (mask->size != projector.facts().size)
      return fail(ErrorCode::InvalidInput, fmt::format("the mask of layer {} has not the projector's size", k));
    upload[k] = projector.load_time(mask->view());
    if (upload[k] > a.longest_upload) {
      a.longest_upload = upload[k];
      a.longest_upload_layer = layer.index;
    }
    if (upload[k] > approach_time(plan, layer.index)) a.too_slow.push_back(layer.index);
    report(progress, WorkStage::EstimatingPrint, double(k + 1) / double(plan.layers.size()));
  }
  const StagePace pace{stage.facts().highest_mm, stage.facts().homing_mm_per_s};
  a.planned = print_time(plan, from, pace, {});
  a.expected = print_time(plan, from, pace, upload);
  return a;
}

Result<void> admit(const Admission& a, double allowed_slowdown) {
  if (a.has_too_short)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the exposure of layer {} is below what the projector can make", a.too_short.count()));
  if (a.slowdown() <= allowed_slowdown) return {};
  return fail(
      ErrorCode::TooLarge,
      fmt::format(
          "{} masks take longer to upload than the platform takes to move, the longest {:.1f} s at layer {}: the "
          "print would take {:.0f} s instead of {:.0f} s. Allow a slower print, settle longer, or use fewer grey "
          "levels",
          a.too_slow.size(), seconds(a.longest_upload), a.longest_upload_layer.count(), seconds(a.expected),
          seconds(a.planned)));
}

std::string to_json(const Admission& a) {
  nlohmann::ordered_json layers = nlohmann::ordered_json::array();
  for (const LayerIndex k : a.too_slow) layers.push_back(k.count());
  return json_text({{"planned_s", seconds(a.planned)},
                    {"expected_s", seconds(a.expected)},
                    {"slowdown", a.slowdown()},
                    {"longest_upload_s", seconds(a.longest_upload)},
                    {"longest_upload_layer", a.longest_upload_layer.count()},
                    {"layers_waiting_for_upload", std::move(layers)}},
                   1) +
         "\n";
}

}  // namespace telefab::fab
