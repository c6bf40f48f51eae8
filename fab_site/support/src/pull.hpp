// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

/// What bearing the pull asked for.
struct PullFigures {
  std::uint32_t added = 0;  ///< anchors
  double demand = 0;        ///< of the worst tip, stress over pull; what is pulled little is left out
};

/// An underside that can take a pin from the platform.
struct PinSite {
  Point2 place;
  LayerIndex layer;
  TipClass widest = TipClass::Light;
};

struct PullOptions {
  std::uint32_t elevation_layers = 0;
  double thickness_mm = 0;  ///< > 0; of a layer
  double most_demand = 0;   ///< > 0; stress over pull that a tip may bear
  bool keeps_tips = false;  ///< no tip becomes narrower than it is, and no anchor is taken away again
  /// Whether a pin from the platform may hold such an anchor. Asked from several threads at once.
  std::function<bool(const Anchor&)> can_stand;
};

/// Widens tips and adds anchors until no tip bears more than it may of the pull on each layer in turn, at every moment:
/// what of the part hangs together by then is rigid, tips are springs as stiff as their pins. The anchors that are
/// there stay, in their places. `layers` are the part's regions. Where nothing helps a tip bears more; the figures say
/// how much. `sites` are looked for where there are none, and stand for as long as layers, machine and options but for
/// `keeps_tips` are the same. Fails with Cancelled.
[[nodiscard]] Result<PullFigures> bear_pull(std::span<const Region> layers, std::vector<Anchor>& anchors,
                                            const MachineProfile& machine, const PullOptions& options,
                                            std::optional<std::vector<PinSite>>& sites, const std::stop_token& stop);

}  // namespace telefab::fab
