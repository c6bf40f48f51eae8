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

 private:
  const LayerStack* stack_;
  const SupportPlan* supports_;
};

/// Makes masks, in blocks of layers that know nothing of each other, so that any number of threads gives the same.
class MaskMaker {
 public:
  struct Made {
    std::uint32_t index = 0;
    Mask mask;
    std::vector<Contour> section;  ///< of the supports
  };
  /// Takes a finished layer; `cured` turns its mask into what is solid in the finished print, as
  /// BlendStack::mark_cured does.
  using Take = std::function<Result<void>(Made made, const std::function<void(Mask&)>& cured)>;

  virtual ~MaskMaker() = default;
  MaskMaker(const MaskMaker&) = delete;
  MaskMaker& operator=(const MaskMaker&) = delete;
  [[nodiscard]] virtual std::uint32_t block_layers() const = 0;
  /// Layers first to first + count - 1 in any order, from one thread. Threads: from several at once.
  [[nodiscard]] virtual Result<MaskFigures> make(std::uint32_t first, std::uint32_t count, const Take& take,
                                                 const std::stop_token& stop) const = 0;

 protected:
  MaskMaker() = default;
};

/// References must outlive what is made. Fails with InvalidInput where the machine's light cannot be modelled.
[[nodiscard]] Result<std::unique_ptr<MaskMaker>> make_mask_maker(const LayerSource& source,
                                                                 const MachineProfile& machine,
                                                                 const PlanOptions& options, const Clock& clock);

}  // namespace telefab::fab
