// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <stop_token>
#include <telefab/base/clock.hpp>
#include <telefab/base/progress.hpp>
#include <telefab/fab/carry/carry_watch.hpp>
#include <telefab/fab/cure/calibration_band.hpp>
#include <telefab/fab/cure/feature_watch.hpp>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/fab/mask/inner_pattern.hpp>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/fab/planning/ready_print.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/fab/verify/support_check.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/image/png.hpp>
#include <telefab/machine/profile_part.hpp>

namespace telefab::fab {

/// What an operator lets pass of contours that the scan does not show; the preflight holds a job that has more.
struct ContourLimits {
  std::optional<double> completed_share;  ///< [0, 1] of the contours' length; none: any
  std::optional<double> doubtful_share;   ///< [0, 1] of the contours' length; none: any
  std::optional<double> gap_mm;           ///< >= 0, from the nearest measured sample; none: any
  std::optional<double> error_mm;         ///< >= 0, possible error of completed stretches; none: any
};

struct PlanOptions {
  std::string job = "job";  ///< name of the job in the plan
  MaskMethod masks = MaskMethod::BlendStack;
  int mask_iterations = 20;  ///< 1 to 1000; of solved masks
  /// Most time spent on solving one mask; what is not solved by then keeps its cover and is reported. 0: no limit, and
  /// only then is the plan the same on every run.
  std::chrono::nanoseconds mask_deadline{0};
  double support_grey = 1;            ///< (0, 1]; irradiance of supports as share of white, solved masks only
  InnerPattern pattern;               ///< of the inside; other than Solid for BlendStack only
  bool compensate_undersides = true;  ///< BlendStack: layers over a void stay dark where later ones shine through
  /// How deep one normal exposure cures, (0, 20] layers; its time then follows from resin and irradiance, and that of
  /// bottom layers in proportion. 0: the profile's times hold.
  double cure_depth_layers = 0;
  double registration_rms_mm = 0;   ///< of the views the scan was put together from, as printed; 0: not stated
  std::optional<ResinPrice> price;  ///< of the resin, for the report alone; none: not stated
  ContourLimits contour_limits;
  SupportOptions supports;
  std::shared_ptr<const PartRegions> regions;  ///< of the very layers, where they were analysed as they came
  /// What is printed instead of the stack's layers, which are its outlines_of: no supports are added, masks stay as
  /// they are, and what concerns either is passed over.
  std::shared_ptr<const ReadyPrint> ready;
  int threads = 0;  ///< 0 (all cores) to 1024; the plan is the same for any number
  [[nodiscard]] Result<void> validate() const;
};

/// The machine with exposures that follow from a cure depth, as PlanOptions says; itself for 0.
/// Fails with InvalidInput where resin or light have no figures to compute with.
[[nodiscard]] Result<MachineProfile> exposed_to_depth(MachineProfile machine, double cure_depth_layers);

/// The largest layer: what the peel has to pull off the vat.
struct PeelLoad {
  double most_mm2 = 0;  ///< solid or lit (grey-weighted), whichever is more
  LayerIndex layer;     ///< of the print
};

/// What was planned, for reports and pictures. Times are the only part that differs from run to run.
struct PlanSummary {
  PrintPlan plan;
  SupportReport check;  ///< of the final masks
  CarryReport carry;    ///< the same: what the pull of the film asks of them
  ThinReport thin;      ///< of the part's contours and the final masks
  SupportFigures figures;
  ContourLimits contour_limits;  ///< as the options had them
  std::string origin;            ///< ReadyPrint::origin, for people; empty: masks were made here
  std::vector<Anchor> anchors;
  std::uint32_t part_layers = 0;
  std::uint32_t elevation_layers = 0;
  std::string supports_json;  ///< to_json(SupportPlan)
  double cured_mm3 = 0;       ///< of what the masks cure, supports included
  [[nodiscard]] double resin_ml() const { return cured_mm3 / 1000; }
  PeelLoad peel;
  double exposure_s = 0;  ///< of all layers
  double print_s = 0;     ///< from homing to the raised part; uploads are taken to hide
  Image preview;          ///< contact sheet
  MaskMethod masks = MaskMethod::Cover;
  int mask_iterations = 0;
  InnerPattern pattern;
  BlendFigures mask_figures;                   ///< how well solved masks meet their contours
  double white_dose_mj_per_cm2 = 0;            ///< of a normal exposure
  double cure_depth_mm = 0;                    ///< of it; negative where it cures nothing
  std::optional<CalibrationBand> calibration;  ///< of it; none where the profile states no intervals
  double registration_rms_mm = 0;              ///< as the options said it
  std::optional<ResinPrice> price;             ///< the same
  std::size_t specks = 0;      ///< specks smaller than a pin's tip that would have floated and got no light
  std::uint32_t repairs = 0;   ///< times the print was planned again because of what its masks showed
  double support_seconds = 0;  ///< of all times together, like the next two
  double mask_seconds = 0;
  double carry_seconds = 0;  ///< judging whether it carries
};

/// One print layer as it leaves the planner. Views live as long as the call.
struct PlannedImage {
  LayerIndex index;
  std::span<const std::byte> png;     ///< of the mask
  std::span<const Contour> supports;  ///< the support's rings, canonical order
};
/// Takes the next print layer. Called in order, from one thread. Where the print has to be planned again it is called
/// from layer 0 on again: what came before is void.
using PlanSink = std::function<Result<void>(const PlannedImage&)>;

/// Plans a print: supports (section 4), one mask a layer with part and supports merged (section 5), exposures with
/// longer bottom layers, and an independent check of the final masks. Where the check finds islands (masks may leave
/// dark what joins two regions) each gets an anchor of its own, where it finds that a pin bears more than it may others
/// are given it for help, and the print is planned again, four times at most; specks smaller than a pin's tip get no
/// light instead; what floats even then is in `check`. The stack must fit the machine: bounds on its platform, part and
/// elevation below its Z travel. Fails: InvalidInput (does not fit, thickness differs from the machine's; both figures
/// are named), Cancelled, and whatever the sink fails with. Deterministic on any number of threads.
[[nodiscard]] Result<PlanSummary> plan_job(const LayerStack& stack, const MachineProfile& machine,
                                           const PlanOptions& options, const PlanSink& sink, const Clock& clock,
                                           const ProgressSink& progress, std::stop_token stop);

/// report.json of the plan.
[[nodiscard]] std::string to_json(const PlanSummary& summary);

}  // namespace telefab::fab
