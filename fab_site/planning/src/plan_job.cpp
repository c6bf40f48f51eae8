// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/planning/drawn_contours.hpp>

#include "plan_pass.hpp"
#include "plan_repair.hpp"

namespace telefab::fab {
namespace {

constexpr int kRepairs = 4;
/// A repair that relieves the worst place by less than this share of what it may bear was none.
constexpr double kLeastRelief = 0.002;

/// Where the planner itself finds so many times what tips may bear, more of the same gains nothing.
constexpr double kHopeless = 1.5;

bool is_worse(const PlanFaults& now, const PlanFaults& before) {
  return now.islands != before.islands ? now.islands > before.islands : now.overload > before.overload;
}
bool gained(const PlanFaults& now, const PlanFaults& before) {
  return now.islands > 0 || now.islands < before.islands || now.overload < before.overload - kLeastRelief;
}

}  // namespace

Result<PlanSummary> plan_job(const LayerStack& stack, const MachineProfile& machine, const PlanOptions& options,
                             const PlanSink& sink, const Clock& clock, const ProgressSink& progress,
                             std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (options.ready)
    return PlanPasses{stack, machine, options, sink, clock, progress, std::move(stop)}.plan(options.supports);
  const Millimetres growth{machine.resin.hole_growth_mm};
  const auto drawn = with_grown_holes(stack, growth);
  if (!drawn) return tl::unexpected{drawn.error()};
  const auto mode = options.supports.mode;
  PlanOptions shared = options;
  if (growth.count() != 0) shared.regions.reset();  // they are of the layers as they came
  PlanPasses passes{*drawn, machine, shared, sink, clock, progress, std::move(stop)};
  SupportOptions supports = options.supports, best = supports;
  std::optional<PlanFaults> fewest;
  double support_seconds = 0, mask_seconds = 0, carry_seconds = 0;
  bool is_last = mode == SupportOptions::Mode::None;
  for (std::uint32_t round = 0;; ++round) {
    auto planned = passes.plan(supports);
    if (!planned) return planned;
    planned->support_seconds = support_seconds += planned->support_seconds;
    planned->mask_seconds = mask_seconds += planned->mask_seconds;
    planned->carry_seconds = carry_seconds += planned->carry_seconds;
    planned->repairs = round;
    PlanFaults faults = faults_of(*planned, machine);
    const bool is_hopeless = planned->figures.bearing_demand > kHopeless * machine.carried_demand();
    if (mode != SupportOptions::Mode::Auto || is_hopeless) faults.overload = 0;
    if (is_last || faults.none()) return planned;
    if (fewest && is_worse(faults, *fewest)) {
      // As before, then.
      supports = best;
      is_last = true;
      continue;
    }
    if (round == kRepairs || (fewest && !gained(faults, *fewest))) return planned;
    fewest = faults;
    best = supports;
    passes.repair_last();
    const bool holds = faults.islands > 0 && hold_islands(*planned, machine.projection.pixel_pitch_mm, supports);
    const bool relieves = faults.overload > 0 && relieve_pins(*planned, machine, supports);
    if (!holds && !relieves) return planned;
  }
}

}  // namespace telefab::fab
