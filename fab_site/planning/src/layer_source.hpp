// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/geometry/layer.hpp>

namespace telefab::fab {

/// What one print layer is made of.
struct SourceLayer {
  SourceLayer() = default;
  SourceLayer(SourceLayer&&) = default;  // not copied: `part` may look into `bounded`
  SourceLayer& operator=(SourceLayer&&) = default;

  std::span<const Contour> part;  ///< as long as the stack lives, or `bounded`
  std::vector<Contour> bounded;   ///< what the part's rings enclose, where some of them enclose nothing
  std::vector<Contour> supports;  ///< without what lies in the part, so that nothing is drawn twice
  std::vector<Contour> section;   ///< of the supports, whole
};

/// The layers of a print, supports' base included.
class LayerSource {
 public:
  LayerSource(const LayerStack& stack, const SupportPlan& supports) : stack_{&stack}, supports_{&supports} {}
  [[nodiscard]] std::uint32_t count() const { return stack_->header().layer_count + supports_->elevation_layers(); }
  /// Threads: from several at once. Fails as Region::from_contours does.
  [[nodiscard]] Result<SourceLayer> layer(std::uint32_t print_layer) const;
  /// SourceLayer::section alone. Threads: from several at once.
  [[nodiscard]] std::vector<Contour> section(std::uint32_t print_layer) const {
    return supports_->section(LayerIndex{print_layer});
  }

 private:
  const LayerStack* stack_;
  const SupportPlan* supports_;
};

}  // namespace telefab::fab
