// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <telefab/fab/cure/cured_solid.hpp>
#include <telefab/geometry/limits.hpp>

namespace telefab::fab {
namespace {

/// What a block of layers may hold at once, masks and doses together.
constexpr std::size_t kBlockBytes = 192U << 20U;
constexpr std::size_t kMostBlock = 16;

struct Work {
  Result<LitLayer> light;
  DoseField dose;
  Result<void> outcome;
  CuredSolid::Layer layer;
};

}  // namespace

std::optional<LayerIndex> CuredSolid::first_difference(const CuredSolid& other) const {
  const std::size_t common = std::min(layers.size(), other.layers.size());
  for (std::size_t i = 0; i < common; ++i)
    if (layers[i].digest != other.layers[i].digest) return LayerIndex{static_cast<std::uint32_t>(i)};
  if (layers.size() != other.layers.size()) return LayerIndex{static_cast<std::uint32_t>(common)};
  return std::nullopt;
}

Result<void> CureOptions::validate() const {
  if (sub_pixels < 1 || sub_pixels > 16)
    return fail(ErrorCode::InvalidInput, fmt::format("{} sub-pixels; 1 to 16 are possible", sub_pixels));
  if (threads < 0 || threads > 1024)
    return fail(ErrorCode::InvalidInput, fmt::format("{} threads; 0 (all cores) to 1024 are possible", threads));
  return {};
}

Result<CuredSolid> cure_solid(const CureModel& model, std::uint32_t layers, const LightSource& source,
                              const CureOptions& options, const ProgressSink& progress, std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (layers > kMaxLayers)
    return fail(ErrorCode::InvalidInput, fmt::format("{} layers; at most {} are possible", layers, kMaxLayers));
  const std::size_t pixels = std::size_t{model.mask.width_px} * model.mask.height_px;
  const std::size_t block = std::clamp<std::size_t>(kBlockBytes / (5 * pixels), 1, kMostBlock);
  tbb::task_arena arena{options.threads == 0 ? tbb::task_arena::automatic : options.threads};
  DoseStream stream{model};
  CuredSolid solid;
  solid.layers.resize(layers);
  const auto kernel = std::make_shared<const PixelKernel>(model.spread_px);
  DoseField above{kernel};
  for (std::uint32_t done = 0; done < layers;) {
    if (stop.stop_requested()) return cancelled("curing");
    const auto count = static_cast<std::uint32_t>(std::min<std::size_t>(block, layers - done));
    std::vector<Work> work(count, {LitLayer{}, DoseField{kernel}, {}, {}});
    const auto index_of = [&](std::uint32_t i) { return LayerIndex{layers - 1 - done - i}; };
    arena.execute([&] { tbb::parallel_for(0U, count, [&](std::uint32_t i) { work[i].light = source(index_of(i)); }); });
    for (std::uint32_t i = 0; i < count; ++i) {
      if (!work[i].light) return tl::unexpected{work[i].light.error()};
      std::vector<MaskExposure> exposures;
      for (std::size_t e = 0; e < work[i].light->masks.size() && e < work[i].light->lit.size(); ++e)
        exposures.push_back({work[i].light->masks[e].view(), work[i].light->lit[e]});
      Result<DoseField> dose = arena.execute([&] { return stream.descend(exposures); });
      if (!dose) return fail_in(fmt::format("layer {}", index_of(i).count()), dose.error());
      work[i].dose = std::move(*dose);
      work[i].light = LitLayer{};
      if (options.in_order)
        if (auto seen = options.in_order(index_of(i), work[i].dose); !seen) return tl::unexpected{seen.error()};
    }
    arena.execute([&] {
      tbb::parallel_for(0U, count, [&](std::uint32_t i) {
        const DepthMap depths = DepthMap::of(work[i].dose, model, options.sub_pixels);
        work[i].layer = {depths.digest(),
                         depths.volume() * model.pixel_pitch_mm * model.pixel_pitch_mm * model.layer_mm};
        if (options.each)
          work[i].outcome = options.each({index_of(i), model, work[i].dose, i ? work[i - 1].dose : above, depths});
      });
    });
    for (std::uint32_t i = 0; i < count; ++i) {
      if (!work[i].outcome) return tl::unexpected{work[i].outcome.error()};
      solid.layers[index_of(i).count()] = work[i].layer;
      if (options.done) options.done(index_of(i));
    }
    above = std::move(work.back().dose);
    done += count;
    report(progress, WorkStage::CuringSolid, static_cast<double>(done) / layers);
  }
  Hasher hasher;
  for (const CuredSolid::Layer& layer : solid.layers) {
    solid.volume_mm3 += layer.volume_mm3;
    hasher.feed(std::as_bytes(std::span{layer.digest.bytes}));
  }
  solid.digest = hasher.digest();
  return solid;
}

Result<CuredSolid> cure_recorded(const CureModel& model, std::span<const LitRecord> records,
                                 const std::function<Result<Mask>(const Digest&)>& mask_of,
                                 const CureOptions& options) {
  struct Sum {
    Digest mask;
    std::chrono::nanoseconds lit{};
  };
  std::map<std::uint32_t, std::vector<Sum>> lit;
  std::uint32_t layers = 0;
  for (const LitRecord& record : records) {
    const double at = record.z_mm / model.layer_mm - 1;
    const double whole = std::round(at);
    // A stage at rest is off by micrometres, never by a quarter of a layer.
    if (!(std::abs(at - whole) < 0.25) || whole < 0 || whole >= kMaxLayers)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("light at a gap of {} mm, which is not a layer of {} mm", record.z_mm, model.layer_mm));
    const auto index = static_cast<std::uint32_t>(whole);
    layers = std::max(layers, index + 1);
    auto& sums = lit[index];
    const auto same = std::find_if(sums.begin(), sums.end(), [&](const Sum& s) { return s.mask == record.mask; });
    if (same != sums.end())
      same->lit += record.lit;
    else
      sums.push_back({record.mask, record.lit});
  }
  // Sums of floats depend on their order; a record's own order may not.
  for (auto& [index, sums] : lit)
    std::sort(sums.begin(), sums.end(), [](const Sum& a, const Sum& b) { return a.mask.bytes < b.mask.bytes; });
  const LightSource source = [&](LayerIndex index) -> Result<LitLayer> {
    LitLayer layer;
    const auto at = lit.find(index.count());
    if (at == lit.end()) return layer;
    for (const Sum& sum : at->second) {
      auto mask = mask_of(sum.mask);
      if (!mask) return tl::unexpected{mask.error()};
      layer.masks.push_back(std::move(*mask));
      layer.lit.push_back(sum.lit);
    }
    return layer;
  };
  return cure_solid(model, layers, source, options, {}, {});
}

}  // namespace telefab::fab
