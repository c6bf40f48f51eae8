// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/edge_error.hpp>

#include "ring_index.hpp"

namespace telefab::fab {

/// Follows columns of pixels down from where the part ends to where the cured resin does.
class UndersideWatch {
 public:
  explicit UndersideWatch(const CureModel& model) : model_{model} {}

  /// One layer of the print further down, its part and what else is lit there. Rows are those of the mask from the
  /// front.
  void descend(const DoseField& dose, const RingIndex& part, const RingIndex& joined);
  /// Below the last layer lies the platform.
  void finish();
  /// Error of undersides in layers, positive where cured too deep; those that overhang by more than 1.5 px, away from
  /// their rims and from supports.
  [[nodiscard]] const DistanceTally& errors() const { return errors_; }

 private:
  struct Column {
    int x, y;
    int layers;  ///< passed since the part ended
  };
  CureModel model_;
  RingIndex above_{{}, 1};
  std::vector<Column> open_;
  DistanceTally errors_;
};

}  // namespace telefab::fab
