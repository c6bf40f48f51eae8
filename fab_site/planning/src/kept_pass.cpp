// SPDX-License-Identifier: GPL-3.0-or-later
#include "kept_pass.hpp"

#include <algorithm>

namespace telefab::fab {
namespace {

constexpr std::size_t kMostBytes = 64U << 20U;

}  // namespace

void KeptPass::keep(const MaskMaker::Layers& block, std::vector<std::shared_ptr<const KeptLayer>> layers,
                    const BlendFigures& figures) {
  std::size_t more = 0;
  for (const auto& layer : layers) more += layer->bytes();
  if (!keeps_ || bytes_ + more > kMostBytes) return;
  bytes_ += more;
  std::ranges::move(layers, layers_.begin() + block.first);
  figures_[block.first] = figures;
}

bool KeptPass::is_same(const SupportPlan& supports, const MaskMaker::Layers& layers) const {
  for (std::uint32_t i = layers.first; i < layers.behind; ++i)
    if (!supports_.has_same_section(supports, LayerIndex{i})) return false;
  return true;
}

bool KeptPass::stands(const MaskMaker::Layers& block, const MaskMaker::Layers& looked_at,
                      const SupportPlan& supports) const {
  return layers_[block.first] && is_same(supports, looked_at);
}

bool KeptPass::is_same(const SupportPlan& supports) const {
  return is_same(supports, {0, static_cast<std::uint32_t>(layers_.size())});
}

}  // namespace telefab::fab
