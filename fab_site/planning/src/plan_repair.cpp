// SPDX-License-Identifier: GPL-3.0-or-later
#include "plan_repair.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telefab::fab {
namespace {

/// A pin that was found too weak is to bear this share of what it may.
constexpr double kRelief = 0.85;
constexpr double kLeastStrength = 0.05;
/// What bears the part's own weight in a section this much above a contact is part, not pin.
constexpr std::uint32_t kTipLayers = 4;

double distance_mm(Point2 p, Point2 a, Point2 b) {
  const double vx = b.x_mm - a.x_mm, vy = b.y_mm - a.y_mm, length2 = vx * vx + vy * vy;
  const double along =
      length2 > 0 ? std::clamp(((p.x_mm - a.x_mm) * vx + (p.y_mm - a.y_mm) * vy) / length2, 0.0, 1.0) : 0.0;
  return std::hypot(p.x_mm - a.x_mm - along * vx, p.y_mm - a.y_mm - along * vy);
}

/// The anchor whose pin passes through that place, if any.
const Anchor* pin_at(const CarryPlace& place, const PlanSummary& planned, double within_mm) {
  const Anchor* nearest = nullptr;
  double best = within_mm;
  for (const Anchor& a : planned.anchors) {
    if (a.layer.count() + planned.elevation_layers + kTipLayers < place.layer.count()) continue;
    const double d = distance_mm(place.place, a.place, a.foot);
    if (d < best) best = d, nearest = &a;
  }
  return nearest;
}

}  // namespace

PlanFaults faults_of(const PlanSummary& planned, const MachineProfile& machine) {
  const CarryPlace* worst = planned.carry.worst();
  const double over = worst ? worst->demand / machine.carried_demand() - 1 : 0;
  return {planned.check.count(Finding::Kind::Island), std::max(0.0, over)};
}

bool hold_islands(const PlanSummary& planned, double pitch_mm, SupportOptions& supports) {
  const std::size_t known = supports.floating.size();
  for (const Finding& found : planned.check.findings) {
    if (found.kind != Finding::Kind::Island || found.layer.count() < planned.elevation_layers) continue;
    const LayerIndex layer{found.layer.count() - planned.elevation_layers};
    const bool is_known =
        std::any_of(supports.floating.begin(), supports.floating.end(), [&](const SupportOptions::Floating& f) {
          return f.layer == layer &&
                 std::hypot(f.place.x_mm - found.place.x_mm, f.place.y_mm - found.place.y_mm) < pitch_mm;
        });
    if (!is_known) supports.floating.push_back({found.place, layer});
  }
  return supports.floating.size() > known;
}

bool relieve_pins(const PlanSummary& planned, const MachineProfile& machine, SupportOptions& supports) {
  std::vector<double> demand(planned.anchors.size());
  const double within_mm = 2 * machine.supports.pin_radius_mm;
  for (const auto* list : {&planned.carry.weak, &planned.carry.weak_small})
    for (const CarryPlace& place : *list)
      if (const Anchor* pin = pin_at(place, planned, within_mm)) {
        double& most = demand[static_cast<std::size_t>(pin - planned.anchors.data())];
        most = std::max(most, place.demand);
      }
  bool any = false;
  supports.bearing.clear();
  for (std::size_t a = 0; a < planned.anchors.size(); ++a) {
    const Anchor& anchor = planned.anchors[a];
    SupportOptions::Bearing kept{anchor.place, anchor.layer, anchor.tip, anchor.strength};
    if (demand[a] > 0) {
      kept.strength = std::max(kLeastStrength, kept.strength * kRelief * machine.carried_demand() / demand[a]);
      any = any || kept.strength < anchor.strength;
    }
    supports.bearing.push_back(kept);
  }
  return any;
}

}  // namespace telefab::fab
