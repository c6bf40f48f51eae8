// SPDX-License-Identifier: GPL-3.0-or-later
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
  // By bending, where no length is stated: then what it is attached to does not enter.
  const bool is_stated = machine.supports.self_support_mm > 0;
  law.least = Millimetres{is_stated ? machine.supports.self_support_mm : machine.self_support_reach_mm(0)};
  law.growth_per_mm = is_stated ? machine.supports.self_support_growth_per_mm : 0;
  law.most = is_stated ? Millimetres{machine.supports.self_support_most_mm} : law.least;
  law.least_remainder = Millimetres{pixel / 4};
  law.speck_mm2 = 2 * pixel * pixel;
  law.contact = Millimetres{0.9 * pixel};
  law.neck = Millimetres{0.45 * pixel};
  law.arc_tolerance = Millimetres{pixel / 10};
  return law;
}

namespace {

double length_mm(const Region& region) {
  double length = 0;
  for (const GridRing& ring : region.rings())
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const GridPoint a = ring[i], b = ring[i + 1 < ring.size() ? i + 1 : 0];
      length += std::hypot(static_cast<double>(b.x - a.x), static_cast<double>(b.y - a.y));
    }
  return length / kGridStepsPerMm;
}

bool holds(const Region& contact, const SelfSupportLaw& law) {
  const double area = contact.area_mm2();
  // A tenth above the four pixels that count as an island: the regions here are simplified ones.
  if (area < 2.2 * law.speck_mm2) return false;
  // The largest disc inside has at least the radius area / boundary: that settles all but the slight ones.
  if (area >= law.contact.count() * length_mm(contact)) return true;
  return !offset(contact, Millimetres{-law.contact.count()}, law.arc_tolerance).empty();
}

/// True where the piece that the contact belongs to lies on the layer below but for less than a pixel: a fading tip
/// needs no pin, however small it is.
bool rests(const Region& contact, std::span<const Region> pieces, const Region& below, const SelfSupportLaw& law) {
  const Point2 inside = inner_point(contact);
  for (const Region& piece : pieces)
    if (piece.contains(inside))
      return subtract(piece, below).area_mm2() <=
             std::max(0.05 * law.speck_mm2, std::min(0.5 * law.speck_mm2, 0.2 * piece.area_mm2()));
  return false;
}

/// What stays connected to no contact once the current layer is thinned by the neck's half width.
std::vector<Region> hanging_by_a_neck(const Region& current, std::span<const Region> contacts,
                                      const SelfSupportLaw& law) {
  const Region core = offset(current, Millimetres{-law.neck.count()}, law.arc_tolerance);
  const auto blobs = core.pieces();
  if (blobs.size() <= 1 && !contacts.empty()) return {};
  std::vector<Point2> held;
  for (const Region& piece : intersect(core, unite(contacts)).pieces()) held.push_back(inner_point(piece));
  std::vector<Region> hanging;
  for (const Region& blob : blobs) {
    if (blob.area_mm2() < law.speck_mm2 / 10) continue;
    if (std::none_of(held.begin(), held.end(), [&](Point2 p) { return blob.contains(p); })) hanging.push_back(blob);
  }
  return hanging;
}

/// Pieces that touch nothing below and are too thin to show as a blob, but not too thin to cure: a neighbour's reach
/// across the gap does not hold them.
void add_thin_pieces(const Region& current, std::span<const Region> contacts, const SelfSupportLaw& law,
                     std::vector<Region>& islands) {
  auto pieces = current.pieces();
  if (pieces.size() <= 1) return;
  const std::size_t blobs = islands.size();
  for (Region& piece : pieces) {
    if (piece.area_mm2() < 2 * law.speck_mm2) continue;
    const auto inside = [&](const Region& part) { return piece.contains(inner_point(part)); };
    if (std::any_of(contacts.begin(), contacts.end(), inside)) continue;
    if (std::any_of(islands.begin(), islands.begin() + static_cast<std::ptrdiff_t>(blobs), inside)) continue;
    if (offset(piece, Millimetres{-law.least_remainder.count()}, law.arc_tolerance).empty()) continue;
    islands.push_back(std::move(piece));
  }
}

}  // namespace

LayerRegions analyse_layer(const Region& below, const Region& current, const SelfSupportLaw& law) {
  LayerRegions out;
  if (current.empty()) return out;
  out.attached = intersect(below, current);
  // Most layers of most parts only shrink: what does not reach beyond the layer below needs no offset.
  if (!out.attached.empty() && subtract(current, below).empty()) {
    out.self_supported = current;
    return out;
  }
  std::vector<Region> grown, contacts, pieces;
  for (Region& piece : out.attached.pieces()) {
    if (!holds(piece, law)) {
      if (pieces.empty()) pieces = current.pieces();
      if (!rests(piece, pieces, below, law)) continue;
    }
    grown.push_back(offset(piece, law.reach(piece.area_mm2()), law.arc_tolerance));
    contacts.push_back(std::move(piece));
  }
  const Region reach = grown.size() == 1 ? std::move(grown.front()) : unite(grown);
  out.islands = hanging_by_a_neck(current, contacts, law);
  add_thin_pieces(current, contacts, law, out.islands);
  const Region hanging = intersect(offset(unite(out.islands), law.neck, law.arc_tolerance), current);
  out.self_supported = subtract(intersect(reach, current), hanging);
  out.to_support = subtract(current, reach);
  if (!out.to_support.empty() && law.least_remainder.count() > 0) {
    const Region core = offset(out.to_support, Millimetres{-law.least_remainder.count()}, law.arc_tolerance);
    out.to_support =
        intersect(offset(core, Millimetres{law.least_remainder.count() * 1.05}, law.arc_tolerance), out.to_support);
  }
  out.to_support = unite(out.to_support, hanging);
  return out;
}

Region without_specks(Region layer, const Region& below, double speck_mm2) {
  if (layer.rings().size() == 1 && layer.area_mm2() >= speck_mm2) return layer;
  std::vector<GridRing> kept;
  bool dropped = false;
  for (const Region& piece : layer.pieces()) {
    if (piece.area_mm2() < speck_mm2 && intersect(piece, below).area_mm2() <= 0) {
      dropped = true;
      continue;
    }
    kept.insert(kept.end(), piece.rings().begin(), piece.rings().end());
  }
  return dropped ? Region::from_rings(kept).value_or(Region{}) : layer;
}

std::vector<Region> without_specks(std::vector<Region> layers, double speck_mm2) {
  const Region nothing;
  for (std::size_t k = 0; k < layers.size(); ++k)
    layers[k] = without_specks(std::move(layers[k]), k == 0 ? nothing : layers[k - 1], speck_mm2);
  return layers;
}

}  // namespace telefab::fab
