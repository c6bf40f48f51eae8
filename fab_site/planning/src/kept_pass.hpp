// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/fab/planning/plan_job.hpp>

#include "mask_maker.hpp"
#include "packed_mask.hpp"

namespace telefab::fab {

/// A layer as the mask maker gave it.
struct KeptLayer {
  PackedMask mask;
  PackedMask cured;  ///< what is solid in the finished print, as MaskMaker::Take has it
  [[nodiscard]] std::size_t bytes() const { return mask.bytes() + cured.bytes(); }
};

/// What a pass of a plan leaves to the next, whose supports differ in some places: the masks of blocks that look at
/// none of them stay. As many layers as fit into some memory, from below.
class KeptPass {
 public:
  /// `keeps`: whether masks are worth keeping.
  KeptPass(SupportPlan supports, std::uint32_t print_layers, bool keeps)
      : supports_{std::move(supports)}, layers_(print_layers), figures_(print_layers), keeps_{keeps} {}

  [[nodiscard]] const SupportPlan& supports() const { return supports_; }
  /// Layers of a block, in order, and how well they were solved. Passed over where memory is spent.
  void keep(const MaskMaker::Layers& block, std::vector<std::shared_ptr<const KeptLayer>> layers,
            const BlendFigures& figures);
  /// Whether the block is here, and what it looks at is the same with those supports.
  [[nodiscard]] bool stands(const MaskMaker::Layers& block, const MaskMaker::Layers& looked_at,
                            const SupportPlan& supports) const;
  /// Of a layer of a block that stands.
  [[nodiscard]] const std::shared_ptr<const KeptLayer>& layer(std::uint32_t index) const { return layers_[index]; }
  /// Of a block that stands, by its first layer.
  [[nodiscard]] const BlendFigures& figures(std::uint32_t first) const { return figures_[first]; }
  /// Whether those supports are the same in all layers.
  [[nodiscard]] bool is_same(const SupportPlan& supports) const;

  std::optional<PlanSummary> summary;  ///< of the pass, once it is done

 private:
  [[nodiscard]] bool is_same(const SupportPlan& supports, const MaskMaker::Layers& layers) const;

  SupportPlan supports_;
  std::vector<std::shared_ptr<const KeptLayer>> layers_;  ///< by print layer; none: not kept
  std::vector<BlendFigures> figures_;                     ///< by the first layer of a block
  std::size_t bytes_ = 0;
  bool keeps_;
};

}  // namespace telefab::fab
