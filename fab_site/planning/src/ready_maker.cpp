// SPDX-License-Identifier: GPL-3.0-or-later
#include "ready_maker.hpp"

#include <fmt/format.h>

#include <mutex>

#include "mask_passes.hpp"

namespace telefab::fab {
namespace {

class ReadyMaker final : public MaskMaker {
 public:
  ReadyMaker(const ReadyPrint& print, PixelSize size) : print_{print}, size_{size} {}

  [[nodiscard]] std::uint32_t block_layers() const override { return 8; }

  [[nodiscard]] Layers looked_at(const Layers& block) const override { return block; }
  [[nodiscard]] Result<void> read(std::span<const Layers> /*blocks*/, const std::stop_token& /*stop*/) override {
    return {};
  }

  [[nodiscard]] Result<BlendFigures> make(const Layers& block, const Take& take, const std::stop_token& stop) override {
    for (std::uint32_t i = block.first; i < block.behind; ++i) {
      if (stop.stop_requested()) return cancelled("planning");
      auto mask = mask_of(i);
      if (!mask) return tl::unexpected{mask.error()};
      if (auto ok = take({i, std::move(*mask), {}}, [](Mask& m) { keep_from(kReadySolid, m.rows); }); !ok)
        return tl::unexpected{ok.error()};
    }
    return BlendFigures{};
  }

 private:
  /// Masks have one reader at a time.
  [[nodiscard]] Result<Mask> mask_of(std::uint32_t layer) const {
    const std::scoped_lock lock{mutex_};
    return ready_mask(print_, LayerIndex{layer}, size_);
  }

  const ReadyPrint& print_;
  PixelSize size_;
  mutable std::mutex mutex_;
};

}  // namespace

Result<Mask> ready_mask(const ReadyPrint& print, LayerIndex layer, PixelSize size) {
  auto mask = print.masks->mask(layer);
  if (mask && !(mask->size == size))
    return fail(ErrorCode::InvalidInput,
                fmt::format("the mask of layer {} has {} x {} pixels, the machine {} x {}", layer.count(),
                            mask->size.width_px, mask->size.height_px, size.width_px, size.height_px));
  return mask;
}

std::unique_ptr<MaskMaker> ready_mask_maker(const ReadyPrint& print, PixelSize size) {
  return std::make_unique<ReadyMaker>(print, size);
}

}  // namespace telefab::fab
