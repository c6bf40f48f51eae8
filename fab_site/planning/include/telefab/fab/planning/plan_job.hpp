#pragma once
#include <functional>
#include <stop_token>
#include <telefab/base/clock.hpp>
#include <telefab/base/progress.hpp>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/fab/verify/support_check.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/image/png.hpp>

namespace telefab::fab {

/// How grey levels are found.
enum class MaskMethod : std::uint8_t {
  Cover = 1,  ///< the share of each pixel that the region covers
};
[[nodiscard]] std::string_view name_of(MaskMethod method);
[[nodiscard]] Result<MaskMethod> mask_method_from_name(std::string_view name);

struct PlanOptions {
  std::string job = "job";  ///< name of the job in the plan
  MaskMethod masks = MaskMethod::Cover;
  SupportOptions supports;
  int threads = 0;  ///< 0 (all cores) to 1024; the plan is the same for any number
  [[nodiscard]] Result<void> validate() const;
};

/// The largest layer: what the peel has to pull off the vat.
struct PeelLoad {
  double most_mm2 = 0;  ///< grey-weighted
  LayerIndex layer;     ///< of the print
};

/// What was planned, for reports and pictures. Times are the only part that differs from run to run.
struct PlanSummary {
  PrintPlan plan;
  SupportReport check;  ///< of the final masks
  SupportFigures figures;
  std::size_t anchors = 0;
  std::uint32_t part_layers = 0;
  std::uint32_t lift_layers = 0;
  std::string supports_json;  ///< to_json(SupportPlan)
  double cured_mm3 = 0;       ///< grey-weighted volume of all masks
  PeelLoad peel;
  double exposure_s = 0;  ///< of all layers
  double print_s = 0;     ///< exposures, lifts, lowering and settling
  Image preview;          ///< contact sheet
  double support_seconds = 0;
  double mask_seconds = 0;
};

/// One print layer as it leaves the planner. Views live as long as the call.
struct PlannedSheet {
  LayerIndex index;
  std::span<const std::byte> png;     ///< of the mask
  std::span<const Contour> supports;  ///< the support's rings, canonical order
};
/// Takes the next print layer. Called in order, from one thread.
using PlanSink = std::function<Result<void>(const PlannedSheet&)>;

/// Plans a print: supports (section 4), one mask a layer with part and supports merged (section 5), exposures with
/// longer bottom layers, and an independent check of the final masks. The stack must fit the machine: bounds on its
/// platform, part and lift below its Z travel.
/// Fails: InvalidInput (does not fit, thickness differs from the machine's; both figures are named), Cancelled, and
/// whatever the sink fails with. Deterministic on any number of threads.
[[nodiscard]] Result<PlanSummary> plan_job(const LayerStack& stack, const MachineProfile& machine,
                                           const PlanOptions& options, const PlanSink& sink, const Clock& clock,
                                           const ProgressSink& progress, std::stop_token stop);

/// report.json of the plan.
[[nodiscard]] std::string to_json(const PlanSummary& summary);

/// Lift, lowering, settling and exposure of one layer, from the machine's motion.
[[nodiscard]] double layer_seconds(const MachineProfile::Motion& motion, std::chrono::microseconds exposure);

}  // namespace telefab::fab
