// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

struct RoutedStructure {
  Structure structure;
  std::uint32_t feet_on_part = 0;
  std::uint32_t braces = 0;
  std::uint32_t thin_pins = 0;
  std::uint32_t may_buckle = 0;  ///< pins that stand free for too long, in spite of struts and wide feet
  std::uint32_t unreached = 0;   ///< anchors without a pin: none comes up to them from the platform
};

/// Finds pins their places and builds what holds a part. Looks into `layers`, the part's regions, which lie
/// `elevation_layers` above the platform.
class PinRouter {
 public:
  PinRouter(std::span<const Region> layers, std::uint32_t elevation_layers, double thickness_mm,
            const MachineProfile& machine);
  ~PinRouter();
  PinRouter(const PinRouter&) = delete;
  PinRouter& operator=(const PinRouter&) = delete;

  /// Before can_stand() is asked of tips of that class.
  void make_room_for(TipClass tip);
  /// Whether a pin from the platform can hold that anchor with its tip, neighbours apart. Threads: from several at
  /// once.
  [[nodiscard]] bool can_stand(const Anchor& anchor) const;
  /// Builds a tip, an arm where the column below is not free, a pin and a foot for every anchor; then braces and base
  /// plates. Marks anchors whose pin stands on the part, and narrows tips whose pins have no room.
  [[nodiscard]] RoutedStructure route(std::vector<Anchor>& anchors);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace telefab::fab
