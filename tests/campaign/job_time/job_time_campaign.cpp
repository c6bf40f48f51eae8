// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/drivers/dlpc900_projector.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/grbl_stage.hpp>
#include <telefab/fab/drivers/model_transport.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/print/admission.hpp>

// Prints a plan folder on the byte-level models of a light engine and a stage, on a virtual clock, and compares the
// time and the light with what was estimated and planned. The DMD is the smallest that holds the masks.

namespace telefab::fab {
namespace {

constexpr double kHoming_mm_per_s = 20;  ///< of the model of the board

int complain(const Error& error) {
  fmt::print(stderr, "{}\n", error.what);
  return 1;
}

int simulate(const char* folder) {
  auto job = PlannedJob::open(folder);
  if (!job) return complain(job.error());
  const PrintPlan& plan = (*job)->plan();
  double top_mm = plan.z_travel_mm;
  for (const PlannedLayer& layer : plan.layers) top_mm = std::max(top_mm, plan.z_travel_mm + layer.motion.lift_mm);
  const std::uint8_t dmd = plan.mask_size.width_px <= 1920 && plan.mask_size.height_px <= 1080 ? 1 : 2;

  VirtualClock clock;
  MachineLog log;
  Dlpc900Model model{dmd, 6, clock, &log};
  GrblModel board{top_mm, clock, &log};
  board.set_acceleration(plan.acceleration_mm_per_s2);
  auto projector = Dlpc900Projector::open(std::make_unique<ModelUsb>(model, clock),
                                          {.mask = plan.mask_size, .led_current = 255}, clock);
  if (!projector) return complain(projector.error());
  auto stage = SerialStage::open(
      std::make_unique<ModelLine>(board, clock),
      {.top_mm = top_mm, .homing_mm_per_s = kHoming_mm_per_s, .acceleration_mm_per_s2 = plan.acceleration_mm_per_s2},
      clock);
  if (!stage) return complain(stage.error());
  const auto admission = estimate_print(plan, {}, **job, **projector, **stage, {}, {});
  if (!admission) return complain(admission.error());

  auto journal = PrintJournal::open(memory_journal_file());
  PrintRunner runner{**projector, **stage, **job, *journal, clock};
  PrintControl control;
  const Nanoseconds from = clock.now();
  const auto record = runner.run(plan, {}, control, {}, {});
  if (!record) return complain(record.error());
  const double took_s = double((clock.now() - from).count()) * 1e-9;

  double lit_s = 0, planned_s = 0;
  for (const LitSpan& span : log.light()) lit_s += double((span.until - span.from).count()) * 1e-9;
  for (const PlannedLayer& layer : plan.layers) planned_s += double(layer.exposure.count()) * 1e-6;
  const double lit_share = planned_s > 0 ? lit_s / planned_s : 0;
  const double expected_s = double(admission->expected.count()) * 1e-9;
  fmt::print("{}: {} layers, {}, {}\n", plan.job, plan.layers.size(), (*projector)->facts().name,
             name_of(record->outcome));
  fmt::print("motion and light alone {:.1f} s; with uploads {:.1f} s estimated, {:.1f} s simulated: {:+.2f} %\n",
             double(admission->planned.count()) * 1e-9, expected_s, took_s, (took_s / expected_s - 1) * 100);
  fmt::print("layers that wait for their upload: {}; longest upload {:.2f} s (layer {}); rate {:.0f} B/s\n",
             admission->too_slow.size(), double(admission->longest_upload.count()) * 1e-9,
             admission->longest_upload_layer.count(), (*projector)->facts().upload_bytes_per_s);
  fmt::print(
      "light: {:.6f} of the planned time; {} ns while the platform moved; {} findings against the plan; {} refusals\n",
      lit_share, log.light_while_moving().count(), compare(*record, plan).size(), model.refusals());
  if (!record->cause.what.empty()) fmt::print("cause: {}\n", record->cause.what);
  return record->outcome == PrintOutcome::Done && std::abs(lit_share - 1) < 0.01 ? 0 : 1;
}

}  // namespace
}  // namespace telefab::fab

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: job_time_campaign PLAN_FOLDER\n");
    return 1;
  }
  return telefab::fab::simulate(argv[1]);
}
