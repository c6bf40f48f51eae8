// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_work.hpp"

#include <cmath>
#include <telefab/fab/carry/carry_watch.hpp>

#include "mask_passes.hpp"

namespace telefab::fab {
std::chrono::microseconds exposure_of(const MachineProfile& machine, std::uint32_t print_layer) {
  return std::chrono::microseconds{std::llround(machine.exposure_of_layer_s(print_layer) * 1e6)};
}

namespace {

/// What follows from a mask and from what it cures.
LayerWork work_of(std::shared_ptr<const KeptLayer> made, std::uint32_t index, std::vector<Contour> section,
                  const Mask& mask, const Mask& cured, std::uint8_t lit_from) {
  LayerWork work;
  work.index = index;
  work.mask = made->mask;
  work.made = std::move(made);
  work.supports = std::move(section);
  work.light.lit = LayerRuns::from_mask(mask.view(), lit_from);
  work.runs = LayerRuns::from_mask(cured.view(), kCuredPixel);
  work.firm = firm_pixels(mask.view(), work.runs);
  work.light.joined = LayerRuns::from_mask(cured.view(), kJoinedPixel);
  work.solid_pixels = sums_of(cured.rows).white;
  return work;
}

}  // namespace

LayerWork made_layer(MaskMaker::Made made, const std::function<void(Mask&)>& cured, std::uint8_t lit_from) {
  Mask solid = made.mask;
  cured(solid);
  auto kept = std::make_shared<const KeptLayer>(KeptLayer{PackedMask{made.mask}, PackedMask{solid}});
  return work_of(std::move(kept), made.index, std::move(made.section), made.mask, solid, lit_from);
}

LayerWork kept_layer(std::shared_ptr<const KeptLayer> kept, std::uint32_t index, std::vector<Contour> section,
                     std::uint8_t lit_from) {
  const Mask mask = kept->mask.unpacked(), solid = kept->cured.unpacked();
  return work_of(std::move(kept), index, std::move(section), mask, solid, lit_from);
}

std::uint64_t darken_specks(LayerWork& work, const LayerRuns& specks, std::uint8_t lit_from) {
  if (specks.count() == 0) return 0;
  Mask mask = work.mask.unpacked();
  darken(mask, specks, work.runs);
  work.light.lit = LayerRuns::from_mask(mask.view(), lit_from);
  work.mask = PackedMask{mask};
  return components_of(specks, true).components.size();
}

Result<void> encode(LayerWork& work, std::chrono::microseconds exposure, const FeatureWatch& features,
                    const ContactSheet& sheet) {
  const Mask mask = work.mask.unpacked();
  work.mask = {};
  auto png = encode_png_grey(mask.size.width_px, mask.size.height_px, mask.rows);
  if (!png) return tl::unexpected{png.error()};
  work.png = std::move(*png);
  work.digest = digest_of(std::as_bytes(std::span{mask.rows}));
  work.grey_sum = sums_of(mask.rows).grey;
  work.at_features = features.light_of(work.index, {mask.view(), exposure});
  if (sheet.shows(work.index)) work.tile = sheet.tile_of(mask, work.index);
  return {};
}

}  // namespace telefab::fab
