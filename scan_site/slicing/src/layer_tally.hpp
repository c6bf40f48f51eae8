// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/slicing/slice_scan.hpp>

#include "layer_cutter.hpp"
#include "written_check.hpp"

namespace telefab::scan {

/// What was noticed while reading may be the reason of a refusal, and is heard of nowhere else where nothing is sliced.
[[nodiscard]] tl::unexpected<Error> refused(const SliceReport& report, Error why);

/// The last that happens to a layer that was cut: specks go, the report adds it up, the sink gets it.
class LayerTally {
 public:
  /// `report` says all that is known before the first layer. It and the sink outlive the tally.
  LayerTally(SliceReport& report, const LayerSink& sink)
      : report_{report}, sink_{sink}, check_{Vec3{report.size_mm.data()}, report.kernel.spacing_mm} {}

  /// Layers come in order, from one thread at a time. Fails as validate_layer and the sink do.
  [[nodiscard]] Result<void> take(CutLayer&& cut);
  /// Holds all of them against the part that was asked for. Fails as WrittenCheck::verdict does.
  [[nodiscard]] Result<void> finish();

 private:
  SliceReport& report_;
  const LayerSink& sink_;
  WrittenCheck check_;
};

}  // namespace telefab::scan
