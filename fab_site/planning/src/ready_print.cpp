// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <telefab/fab/mask/pixel_rings.hpp>
#include <telefab/fab/planning/ready_print.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/fab/verify/layer_runs.hpp>

#include "mask_budget.hpp"
#include "ready_maker.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint32_t kBlock = 16;  ///< layers that are traced at once, of large masks fewer
/// Stairs of pixels become lines; what is smaller than so many pixels keeps its edges, else it might vanish.
constexpr double kSmooth_px = 0.72, kSmall_px = 60;
constexpr std::size_t kLongestName = 256;

Result<std::vector<Contour>> traced(const Mask& mask, double pitch_mm) {
  const LayerRuns solid = LayerRuns::from_mask(mask.view(), kReadySolid);
  std::int32_t left = std::numeric_limits<std::int32_t>::max(), right = 0;
  std::uint32_t front = mask.size.height_px, back = 0;
  for (std::uint32_t y = 0; y < solid.size().height_px; ++y)
    for (const PixelRun& run : solid.row(y)) {
      left = std::min(left, run.first), right = std::max(right, run.behind);
      front = std::min(front, y), back = y + 1;
    }
  if (right <= left) return std::vector<Contour>{};
  PixelSet pixels{left, static_cast<int>(front), right - left, static_cast<int>(back - front)};
  for (std::uint32_t y = front; y < back; ++y)
    for (const PixelRun& run : solid.row(y))
      for (std::int32_t x = run.first; x < run.behind; ++x) pixels.add(x - left, static_cast<int>(y - front));
  const auto rings = pixels.rings(pitch_mm);
  if (!rings) return rings;
  const auto exact = Region::from_contours(*rings);
  if (!exact) return tl::unexpected{exact.error()};
  std::vector<Region> pieces;
  for (const Region& piece : exact->pieces())
    pieces.push_back(piece.area_mm2() < kSmall_px * pitch_mm * pitch_mm
                         ? piece
                         : simplified(piece, Millimetres{kSmooth_px * pitch_mm}));
  return unite(pieces).to_contours();
}

}  // namespace

Result<LayerStack> outlines_of(const ReadyPrint& print, const MachineProfile& machine, std::string_view name,
                               const ProgressSink& progress, const std::stop_token& stop) {
  const double pitch_mm = machine.projection.pixel_pitch_mm;
  const auto count = static_cast<std::uint32_t>(print.layers.size());
  StackHeader header;
  header.machine = machine.name;
  header.layer_thickness_mm = print.thickness_mm;
  header.pixel_pitch_mm = pitch_mm;
  header.layer_count = count;
  header.scan_name = std::string{name.substr(0, kLongestName)};
  header.bounds = {{0, 0}, {machine.platform.width_mm, machine.platform.depth_mm}};
  std::vector<Layer> layers(count);
  bool any = false;
  const PixelSize size = machine.mask_size();
  const std::uint32_t block = masks_at_once(size, kBlock);
  for (std::uint32_t first = 0; first < count; first += block) {
    if (stop.stop_requested()) return cancelled("reading masks");
    const std::uint32_t in_block = std::min(block, count - first);
    std::vector<Mask> masks;
    for (std::uint32_t i = 0; i < in_block; ++i) {
      auto mask = ready_mask(print, LayerIndex{first + i}, size);
      if (!mask) return tl::unexpected{mask.error()};
      masks.push_back(std::move(*mask));
    }
    std::vector<Result<std::vector<Contour>>> rings(in_block);
    tbb::parallel_for(std::uint32_t{0}, in_block, [&](std::uint32_t i) { rings[i] = traced(masks[i], pitch_mm); });
    for (std::uint32_t i = 0; i < in_block; ++i) {
      if (!rings[i]) return fail_in(fmt::format("the mask of layer {}", first + i), rings[i].error());
      Layer& layer = layers[first + i];
      layer.index = LayerIndex{first + i};
      layer.z_mm = cut_height_mm(layer.index, header.layer_thickness_mm);
      layer.contours = std::move(*rings[i]);
      any = any || !layer.contours.empty();
    }
    report(progress, WorkStage::SortingContours, static_cast<double>(first + in_block) / count);
  }
  if (!any)
    return fail(ErrorCode::InvalidInput, fmt::format("none of its {} masks has a pixel of half of white", count));
  return LayerStack::from_layers(std::move(header), std::move(layers));
}

}  // namespace telefab::fab
