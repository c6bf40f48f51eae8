// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/fab/mask/column_caps.hpp>
#include <telefab/fab/verify/support_check.hpp>

#include "mask_maker.hpp"
#include "mask_passes.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint32_t kSingleLayers = 8;  // a block where layers know nothing of each other
constexpr std::uint32_t kStackLayers = 24;  // a block of the stack, without what it looks through
constexpr std::uint32_t kSolvedAhead = 4;   // of what it looks through, the nearest are solved, the rest drawn
constexpr double kForgotten = 100;          // light is forgotten when this little of it is left

/// Of the deadline a tenth is left for the cover of what is not solved by then.
std::chrono::nanoseconds solving_time(const PlanOptions& options) { return options.mask_deadline * 9 / 10; }

double exposure_ratio(const MachineProfile& machine, std::uint32_t layer) {
  return machine.exposure_of_layer_s(layer) / machine.layers.exposure_s;
}

/// Supports are drawn by cover, but where a long exposure would make them grow they are solved like the part.
BlendTask task_of(const SourceLayer& layer, double exposure) {
  if (exposure > 1 && layer.part.empty()) return {.part = layer.supports, .exposure = exposure};
  return {.part = layer.part, .supports = layer.supports, .exposure = exposure};
}

/// What a single exposure from that grey on cures.
std::function<void(Mask&)> cured_from(std::uint8_t level) {
  return [level](Mask& mask) { keep_from(level, mask.rows); };
}

class SingleMaker final : public MaskMaker {
 public:
  SingleMaker(const LayerSource& source, const MachineProfile& machine, std::unique_ptr<MaskBlender> blender,
              const PlanOptions& options, const Clock& clock)
      : source_{source},
        machine_{machine},
        frame_{mask_frame(machine)},
        level_{cure_level(machine)},
        blender_{std::move(blender)},
        solving_{solving_time(options)},
        clock_{clock} {}

  [[nodiscard]] std::uint32_t block_layers() const override { return kSingleLayers; }
  [[nodiscard]] Layers looked_at(const Layers& block) const override { return block; }
  [[nodiscard]] Result<void> read(std::span<const Layers> /*blocks*/, const std::stop_token& /*stop*/) override {
    return {};  // nothing is shared
  }

  [[nodiscard]] Result<BlendFigures> make(const Layers& block, const Take& take, const std::stop_token& stop) override {
    BlendFigures figures;
    for (std::uint32_t i = block.first; i < block.behind; ++i) {
      if (stop.stop_requested()) return cancelled("planning");
      auto layer = source_.layer(i);
      if (!layer) return tl::unexpected{layer.error()};
      Made made{i, {}, std::move(layer->section)};
      if (blender_) {
        BlendTask task = task_of(*layer, exposure_ratio(machine_, i));
        if (solving_.count() > 0)
          task.out_of_time = [this, until = clock_.now() + solving_] { return clock_.now() >= until; };
        auto blended = blender_->blend(task);
        figures.add(blended.figures);
        made.mask = std::move(blended.mask);
      } else {
        made.mask = rasterise(layer->part, frame_);
        if (!layer->supports.empty()) add_cover(made.mask, layer->supports, frame_.pixel_pitch_mm);
      }
      if (auto ok = take(std::move(made), cured_from(level_)); !ok) return tl::unexpected{ok.error()};
    }
    return figures;
  }

 private:
  const LayerSource& source_;
  const MachineProfile& machine_;
  MaskFrame frame_;
  std::uint8_t level_;
  std::unique_ptr<MaskBlender> blender_;  ///< none: by cover
  std::chrono::nanoseconds solving_;      ///< most of a mask; 0: no limit
  const Clock& clock_;
};

class StackMaker final : public MaskMaker {
 public:
  StackMaker(const LayerSource& source, const MachineProfile& machine, const MaskLight& light, MaskBlender blender,
             std::optional<PatternMaker> pattern, const PlanOptions& options, const Clock& clock)
      : source_{source},
        machine_{machine},
        frame_{mask_frame(machine)},
        blender_{std::move(blender)},
        iterations_{options.mask_iterations},
        ahead_{static_cast<std::uint32_t>(
            std::clamp(std::ceil(std::log(kForgotten) * light.penetration_mm / light.layer_mm), 1.0, 64.0))},
        caps_{light, options.compensate_undersides ? static_cast<int>(ahead_) : 0},
        capped_{options.compensate_undersides},
        pattern_{std::move(pattern)},
        solving_{solving_time(options)},
        clock_{clock} {}

  [[nodiscard]] std::uint32_t block_layers() const override { return kStackLayers; }

  [[nodiscard]] Layers looked_at(const Layers& block) const override {
    const std::uint32_t shell = pattern_ ? pattern_->shell_layers() : 0;
    const std::uint32_t below = std::max(capped_ ? static_cast<std::uint32_t>(caps_.reach()) : 0, shell);
    return {block.first > below ? block.first - below : 0, std::min(source_.count(), lit_until(block) + shell)};
  }

  [[nodiscard]] Result<void> read(std::span<const Layers> blocks, const std::stop_token& stop) override {
    if (blocks.empty()) return {};
    looked_.erase(looked_.begin(), looked_.lower_bound(looked_at(blocks.front()).first));
    std::vector<std::uint32_t> missing;
    for (const Layers& block : blocks) {
      const Layers some = looked_at(block);
      for (std::uint32_t i = some.first; i < some.behind; ++i)
        if (looked_.try_emplace(i).second) missing.push_back(i);
    }
    tbb::parallel_for(std::size_t{0}, missing.size(), [&](std::size_t at) {
      Looked& looked = looked_.find(missing[at])->second;
      if (stop.stop_requested()) return;
      auto layer = source_.layer(missing[at]);
      if (!layer) {
        looked.outcome = tl::unexpected{layer.error()};
        return;
      }
      looked.layer = std::move(*layer);
      if (capped_ || pattern_) looked.solid.emplace(looked.layer.part, looked.layer.supports, frame_);
    });
    if (stop.stop_requested()) return cancelled("planning");
    for (const std::uint32_t i : missing)
      if (const Looked& looked = looked_.find(i)->second; !looked.outcome) return looked.outcome;
    return {};
  }

  [[nodiscard]] Result<BlendFigures> make(const Layers& block, const Take& take, const std::stop_token& stop) override {
    const std::uint32_t first = block.first, count = block.behind - block.first, until = lit_until(block);
    const Layers some = looked_at(block);
    const std::uint32_t lowest = some.first;
    std::vector<Looked*> layers;
    for (std::uint32_t i = some.first; i < some.behind; ++i) layers.push_back(&looked_.find(i)->second);
    std::vector<PixelRuns> cores;
    if (pattern_) {
      std::vector<SolidRows> solid;
      for (const Looked* layer : layers) solid.push_back(*layer->solid);
      cores = pattern_->cores(solid);
    }
    BlendFigures figures;
    BlendStack stack{blender_};
    for (std::uint32_t i = until; i-- > first;) {
      if (stop.stop_requested()) return cancelled("planning");
      SourceLayer& layer = layers[i - lowest]->layer;
      BlendTask task = task_of(layer, exposure_ratio(machine_, i));
      const auto caps = capped_ ? std::optional{caps_of(layers, i, lowest, until)} : std::nullopt;
      if (caps || pattern_)
        task.caps = [&](std::uint32_t y, std::span<std::uint8_t> row) {
          const bool capped = caps && caps->fill(y, row);
          return pattern_ ? pattern_->darken(cores[i - lowest], i, y, capped, row) : capped;
        };
      if (solving_.count() > 0)
        task.out_of_time = [this, end = clock_.now() + solving_] { return clock_.now() >= end; };
      auto blended = stack.descend(task, i < first + count + kSolvedAhead ? iterations_ : 0);
      if (i >= first + count) continue;
      figures.add(blended.figures);
      if (auto ok = take({i, std::move(blended.mask), std::move(layer.section)},
                         [&stack](Mask& mask) { stack.mark_cured(mask); });
          !ok)
        return tl::unexpected{ok.error()};
    }
    return figures;
  }

 private:
  /// What is looked at by blocks that are under way or next.
  struct Looked {
    Result<void> outcome;
    SourceLayer layer;  ///< its section is handed on by the block that makes the layer
    std::optional<SolidRows> solid;
  };

  /// Layers whose light a block looks through.
  [[nodiscard]] std::uint32_t lit_until(const Layers& block) const {
    return std::min(source_.count(), block.behind + ahead_);
  }

  [[nodiscard]] LayerCaps caps_of(const std::vector<Looked*>& layers, std::uint32_t i, std::uint32_t lowest,
                                  std::uint32_t until) const {
    const auto solid = [&](std::uint32_t k) { return &*layers[k - lowest]->solid; };
    const auto reach = static_cast<std::uint32_t>(caps_.reach());
    std::vector<const SolidRows*> below, above;
    for (std::uint32_t k = 1; k <= reach && k <= i; ++k) below.push_back(solid(i - k));
    for (std::uint32_t k = 1; k <= ahead_ && i + k < until; ++k) above.push_back(solid(i + k));
    return {caps_, *solid(i), std::move(below), std::move(above), i < reach};
  }

  const LayerSource& source_;
  const MachineProfile& machine_;
  MaskFrame frame_;
  MaskBlender blender_;
  int iterations_;
  std::uint32_t ahead_;
  CapTable caps_;
  bool capped_;
  std::optional<PatternMaker> pattern_;
  std::chrono::nanoseconds solving_;  ///< most of a mask; 0: no limit
  const Clock& clock_;
  std::map<std::uint32_t, Looked> looked_;  ///< by print layer
};

}  // namespace

Result<std::unique_ptr<MaskMaker>> make_mask_maker(const LayerSource& source, const MachineProfile& machine,
                                                   const PlanOptions& options, const Clock& clock) {
  if (options.masks == MaskMethod::Cover)
    return std::make_unique<SingleMaker>(source, machine, nullptr, options, clock);
  const auto light = mask_light(machine);
  if (!light) return tl::unexpected{light.error()};
  BlendOptions blend;
  blend.iterations = options.mask_iterations;
  blend.support_grey = options.support_grey;
  auto blender = MaskBlender::make(mask_frame(machine), *light, blend);
  if (!blender) return tl::unexpected{blender.error()};
  if (options.masks == MaskMethod::BlendStack) {
    std::optional<PatternMaker> pattern;
    if (options.pattern.kind != InnerPattern::Kind::Solid) {
      auto made = PatternMaker::make(options.pattern, *light, mask_frame(machine));
      if (!made) return tl::unexpected{made.error()};
      pattern = *made;
    }
    return std::make_unique<StackMaker>(source, machine, *light, std::move(*blender), std::move(pattern), options,
                                        clock);
  }
  return std::make_unique<SingleMaker>(source, machine, std::make_unique<MaskBlender>(std::move(*blender)), options,
                                       clock);
}

}  // namespace telefab::fab
