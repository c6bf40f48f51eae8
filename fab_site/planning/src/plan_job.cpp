// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/fab/planning/drawn_contours.hpp>

#include "plan_pass.hpp"

namespace telefab::fab {
namespace {

constexpr int kRepairs = 4;
using Floating = std::vector<SupportOptions::Floating>;

/// Adds the places of islands in the part's layers, as far as they are not known; false where none is new.
bool add_islands(const PlanSummary& planned, double pitch_mm, Floating& floating) {
  const std::size_t known = floating.size();
  for (const Finding& found : planned.check.findings) {
    if (found.kind != Finding::Kind::Island || found.layer.count() < planned.elevation_layers) continue;
    const LayerIndex layer{found.layer.count() - planned.elevation_layers};
    const bool is_known = std::any_of(floating.begin(), floating.end(), [&](const SupportOptions::Floating& f) {
      return f.layer == layer &&
             std::hypot(f.place.x_mm - found.place.x_mm, f.place.y_mm - found.place.y_mm) < pitch_mm;
    });
    if (!is_known) floating.push_back({found.place, layer});
  }
  return floating.size() > known;
}

}  // namespace

Result<PlanSummary> plan_job(const LayerStack& stack, const MachineProfile& machine, const PlanOptions& options,
                             const PlanSink& sink, const Clock& clock, const ProgressSink& progress,
                             std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  const Millimetres growth{machine.resin.hole_growth_mm};
  const auto drawn = with_grown_holes(stack, growth);
  if (!drawn) return tl::unexpected{drawn.error()};
  PlanOptions again = options;
  if (growth.count() != 0) again.regions.reset();  // they are of the layers as they came
  Floating tried = options.supports.floating;
  double support_seconds = 0, mask_seconds = 0, carry_seconds = 0;
  std::size_t fewest = 0;
  bool is_last = options.supports.mode != SupportOptions::Mode::Auto;
  for (std::uint32_t round = 0;; ++round) {
    auto planned = plan_pass(*drawn, machine, again, sink, clock, progress, stop);
    if (!planned) return planned;
    planned->support_seconds = support_seconds += planned->support_seconds;
    planned->mask_seconds = mask_seconds += planned->mask_seconds;
    planned->carry_seconds = carry_seconds += planned->carry_seconds;
    planned->repairs = round;
    const std::size_t islands = planned->check.count(Finding::Kind::Island);
    if (is_last || islands == 0) return planned;
    if (round > 0 && islands > fewest) {
      // Worse than before: as before, then.
      again.supports.floating = tried;
      is_last = true;
      continue;
    }
    fewest = islands;
    tried = again.supports.floating;
    if (round == kRepairs || !add_islands(*planned, machine.projection.pixel_pitch_mm, again.supports.floating))
      return planned;
  }
}

}  // namespace telefab::fab
