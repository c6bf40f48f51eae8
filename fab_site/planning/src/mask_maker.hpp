// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <telefab/fab/mask/blend.hpp>

#include "layer_source.hpp"

namespace telefab::fab {

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
  /// Print layers from `first` up to but without `behind`.
  struct Layers {
    std::uint32_t first = 0, behind = 0;
  };
  /// What the masks of a block follow from.
  [[nodiscard]] virtual Layers looked_at(const Layers& block) const = 0;
  /// Reads what the next blocks look at, which is shared by them; rising from call to call. On oneTBB.
  [[nodiscard]] virtual Result<void> read(std::span<const Layers> blocks, const std::stop_token& stop) = 0;
  /// The layers of a block that was read, in any order, from one thread. Once. Threads: from several at once.
  [[nodiscard]] virtual Result<BlendFigures> make(const Layers& block, const Take& take,
                                                  const std::stop_token& stop) = 0;

 protected:
  MaskMaker() = default;
};

/// References must outlive what is made. Fails with InvalidInput where the machine's light cannot be modelled.
[[nodiscard]] Result<std::unique_ptr<MaskMaker>> make_mask_maker(const LayerSource& source,
                                                                 const MachineProfile& machine,
                                                                 const PlanOptions& options, const Clock& clock);

}  // namespace telefab::fab
