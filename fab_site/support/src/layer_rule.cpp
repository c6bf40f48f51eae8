#include <algorithm>
#include <cmath>
#include <telefab/fab/support/layer_rule.hpp>

namespace telefab::fab {

Millimetres SelfSupportLaw::reach(double attached_area_mm2) const {
  const double grown = least.count() * (1 + growth_per_mm * std::sqrt(std::max(0.0, attached_area_mm2)));
  return Millimetres{std::min(std::max(most.count(), least.count()), grown)};
}

SelfSupportLaw self_support_law(const MachineProfile& machine) {
  const double pixel = machine.projection.pixel_pitch_mm;
  SelfSupportLaw law;
  law.least = Millimetres{machine.supports.self_support_mm};
  law.growth_per_mm = machine.supports.self_support_growth_per_mm;
  law.most = Millimetres{machine.supports.self_support_most_mm};
  law.sliver = Millimetres{pixel / 4};
  law.speck_mm2 = 2 * pixel * pixel;
  law.arc_tolerance = Millimetres{pixel / 10};
  return law;
}

LayerRegions analyse_layer(const Region& below, const Region& current, const SelfSupportLaw& law) {
  LayerRegions out;
  if (current.empty()) return out;
  out.attached = intersect(below, current);
  // Most layers of most parts only shrink: what does not reach beyond the layer below needs no offset.
  if (!out.attached.empty() && subtract(current, below).empty()) {
    out.self_supported = current;
    return out;
  }
  std::vector<Region> grown;
  for (const Region& piece : out.attached.pieces()) {
    const double area = piece.area_mm2();
    if (area < law.speck_mm2) continue;
    grown.push_back(offset(piece, law.reach(area), law.arc_tolerance));
  }
  const Region reach = grown.size() == 1 ? std::move(grown.front()) : unite(grown);
  out.self_supported = intersect(reach, current);
  out.to_support = subtract(current, reach);
  if (!out.to_support.empty() && law.sliver.count() > 0) {
    const Region core = offset(out.to_support, Millimetres{-law.sliver.count()}, law.arc_tolerance);
    out.to_support = intersect(offset(core, Millimetres{law.sliver.count() * 1.05}, law.arc_tolerance), out.to_support);
  }
  return out;
}

std::vector<Region> without_specks(std::vector<Region> layers, double speck_mm2) {
  for (std::size_t k = 0; k < layers.size(); ++k) {
    if (layers[k].rings().size() == 1 && layers[k].area_mm2() >= speck_mm2) continue;
    const auto pieces = layers[k].pieces();
    std::vector<GridRing> kept;
    bool dropped = false;
    for (const Region& piece : pieces) {
      const bool held = k > 0 && intersect(piece, layers[k - 1]).area_mm2() > 0;
      if (piece.area_mm2() < speck_mm2 && !held) {
        dropped = true;
        continue;
      }
      kept.insert(kept.end(), piece.rings().begin(), piece.rings().end());
    }
    if (dropped) layers[k] = Region::from_rings(kept).value_or(Region{});
  }
  return layers;
}

}  // namespace telefab::fab
