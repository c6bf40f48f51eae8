// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/region/region.hpp>
#include <telefab/fab/verify/support_check.hpp>

namespace telefab::fab {
namespace {

struct Checker {
  const PrintGeometry& print;
  const MachineProfile& machine;
  std::stop_token stop;
  double pixel = machine.projection.pixel_pitch_mm;
  double speck = 4 * pixel * pixel;  ///< what the target calls an island, in mm2
  std::vector<Region> part{}, support{}, all{};
  std::vector<std::vector<Finding>> found{};

  Result<void> read() {
    const std::size_t count = print.part.size() + print.elevation_layers;
    part.resize(count), support.resize(count), all.resize(count), found.resize(count);
    std::vector<std::optional<Error>> wrong(count);
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
      if (stop.stop_requested()) return;
      if (k >= print.elevation_layers) {
        auto region = Region::from_contours(print.part[k - print.elevation_layers].contours);
        if (region)
          part[k] = std::move(*region);
        else
          wrong[k] = region.error();
      }
      if (print.support) {
        auto region = Region::from_contours(print.support(LayerIndex{static_cast<std::uint32_t>(k)}));
        if (region)
          support[k] = std::move(*region);
        else
          wrong[k] = region.error();
      }
      all[k] = unite(part[k], support[k]);
    });
    for (const auto& error : wrong)
      if (error) return fail_in("checking supports", *error);
    if (stop.stop_requested()) return cancelled("checking supports");
    return {};
  }

  void note(Finding::Kind kind, std::size_t k, const Region& piece) {
    const LayerIndex layer{static_cast<std::uint32_t>(k)};
    found[k].push_back({kind, layer, layer, inner_point(piece), piece.area_mm2()});
  }

  /// One point of every overlap of two layers that is worth naming.
  [[nodiscard]] std::vector<Point2> contacts_of(const Region& a, const Region& b) const {
    std::vector<Point2> points;
    for (const Region& overlap : intersect(a, b).pieces())
      if (overlap.area_mm2() >= speck / 100) points.push_back(inner_point(overlap));
    return points;
  }

  [[nodiscard]] static bool touched(const Region& piece, const std::vector<Point2>& points) {
    const Bounds2 box = piece.bounds();
    return std::any_of(points.begin(), points.end(), [&](Point2 p) {
      return p.x_mm >= box.min.x_mm && p.y_mm >= box.min.y_mm && p.x_mm <= box.max.x_mm && p.y_mm <= box.max.y_mm &&
             piece.contains(p);
    });
  }

  /// 1. Pieces on nothing.
  void islands(std::size_t k) {
    if (k == 0) return;
    const auto contacts = contacts_of(all[k], all[k - 1]);
    for (const Region& piece : all[k].pieces()) {
      if (piece.area_mm2() < speck || touched(piece, contacts)) continue;
      // A skin narrower than half a pixel cures nowhere.
      if (!offset(piece, Millimetres{-pixel / 4}, Millimetres{pixel / 20}).empty())
        note(Finding::Kind::Island, k, piece);
    }
  }

  /// True where the part's piece around a contact reaches beyond it by less than a pixel: a fading tip, however small.
  [[nodiscard]] bool lies_on_the_layer_below(std::size_t k, const Region& contact) const {
    const Point2 inside = inner_point(contact);
    for (const Region& piece : part[k].pieces())
      if (piece.contains(inside))
        return subtract(piece, part[k - 1]).area_mm2() <= std::min(speck / 4, piece.area_mm2() / 4);
    return false;
  }

  /// True where the part's piece at that point is smaller than two pixels: nothing begins or ends with it.
  [[nodiscard]] bool is_speck(std::size_t k, Point2 at) const {
    for (const Region& piece : part[k].pieces())
      if (piece.contains(at)) return piece.area_mm2() < speck / 2;
    return false;
  }

  /// 2. What rule 4.1 leaves, minus a disc around every anchor that may hold it.
  void reach(std::size_t k) {
    if (k < print.elevation_layers || part[k].empty() || (k == 0)) return;
    const auto& s = machine.supports;
    Region rest = part[k];
    if (k > 0 && !part[k - 1].empty()) {
      const Region contact = intersect(part[k - 1], part[k]);
      for (const Region& piece : contact.pieces()) {
        const double area = piece.area_mm2();
        if (area < speck && !lies_on_the_layer_below(k, piece)) continue;
        const double d = machine.self_support_reach_mm(area);
        rest = subtract(rest, offset(piece, Millimetres{d}, Millimetres{pixel / 20}));
        if (rest.empty()) return;
      }
    }
    if (offset(rest, Millimetres{-pixel / 2}, Millimetres{pixel / 20}).empty()) return;
    const auto layer = static_cast<double>(k - print.elevation_layers);
    const double t = machine.layers.thickness_mm;
    std::vector<Region> near;
    for (const auto& [place, at] : print.anchors) {
      const double rise = (layer - at.count()) * t;
      if (rise >= -1e-9 && rise <= s.anchor_distance_mm)
        near.push_back(
            disc(place, Millimetres{s.anchor_distance_mm * 1.0005}, Millimetres{s.anchor_distance_mm / 4000}));
    }
    rest = subtract(rest, unite(near));
    // Narrower than a pixel is nothing a mask shows.
    const Region core = offset(rest, Millimetres{-pixel / 2}, Millimetres{pixel / 20});
    for (const Region& piece : core.pieces())
      if (!is_speck(k, inner_point(piece))) note(Finding::Kind::OutOfReach, k, piece);
  }

  /// Whether material of the part begins in that layer within a piece of support.
  [[nodiscard]] bool begins_over(const Region& piece, std::size_t k) const {
    const Region held = intersect(piece, part[k]);
    return !held.empty() && (k == 0 || subtract(held, part[k - 1]).area_mm2() >= speck / 8);
  }

  /// 3. Supports with nothing above.
  void free_ends(std::size_t k) {
    if (support[k].empty()) return;
    const auto contacts = k + 1 < all.size() ? contacts_of(support[k], all[k + 1]) : std::vector<Point2>{};
    for (const Region& piece : support[k].pieces()) {
      if (piece.area_mm2() < speck || touched(piece, contacts)) continue;
      // A stump inside the part's own material is its contact, and so is material that begins in its last layer.
      if (subtract(piece, part[k]).area_mm2() <= speck / 4) continue;
      if (begins_over(piece, k)) continue;
      note(Finding::Kind::FreePin, k, piece);
    }
  }

  /// 4. and 5. Hollows of the part alone, on the machine's own raster.
  SupportReport hollows() {
    MaskWatch watch{pixel, 4};
    const PixelSize size = machine.mask_size();
    for (std::size_t k = 0; k < all.size(); ++k) {
      const std::span<const Contour> rings =
          k < print.elevation_layers ? std::span<const Contour>{} : print.part[k - print.elevation_layers].contours;
      const LayerRuns pins = LayerRuns::from_contours(support[k].to_contours(), size, pixel);
      (void)watch.add(LayerRuns::from_contours(rings, size, pixel), &pins);
    }
    return watch.finish();
  }
};

bool before(const Finding& a, const Finding& b) {
  if (a.layer != b.layer) return a.layer < b.layer;
  if (a.kind != b.kind) return a.kind < b.kind;
  return a.place.y_mm != b.place.y_mm ? a.place.y_mm < b.place.y_mm : a.place.x_mm < b.place.x_mm;
}

}  // namespace

std::string_view name_of(Finding::Kind kind) {
  switch (kind) {
    case Finding::Kind::Island:
      return "island";
    case Finding::Kind::OutOfReach:
      return "out-of-reach";
    case Finding::Kind::FreePin:
      return "free-pin";
    case Finding::Kind::TrappedSupport:
      return "trapped-support";
    case Finding::Kind::SuctionCup:
      return "suction-cup";
    case Finding::Kind::ResinTrap:
      return "resin-trap";
  }
  return "island";
}

bool holds_the_job(Finding::Kind kind) { return kind != Finding::Kind::SuctionCup && kind != Finding::Kind::ResinTrap; }

bool SupportReport::passes() const {
  return std::none_of(findings.begin(), findings.end(), [](const Finding& f) { return holds_the_job(f.kind); });
}

std::size_t SupportReport::count(Finding::Kind kind) const {
  return static_cast<std::size_t>(
      std::count_if(findings.begin(), findings.end(), [kind](const Finding& f) { return f.kind == kind; }));
}

namespace {

/// The grey level that gives that dose in that time.
std::uint8_t level_of(const MachineProfile& machine, double dose_mj_per_cm2, double exposure_s) {
  const double full = machine.projection.irradiance_mw_per_cm2 * exposure_s;
  const double share = std::clamp(full > 0 ? dose_mj_per_cm2 / full : 1.0, 1.0 / 255, 1.0);
  return static_cast<std::uint8_t>(
      std::clamp(std::ceil(255 * std::pow(share, 1 / machine.projection.gamma)), 1.0, 255.0));
}

}  // namespace

std::uint8_t cure_level(const MachineProfile& machine) {
  const double needed =
      machine.resin.critical_dose_mj_per_cm2 * std::exp(machine.layers.thickness_mm / machine.resin.penetration_mm);
  return level_of(machine, needed, machine.at_full_light().layers.exposure_s);
}

std::uint8_t gel_level(const MachineProfile& machine, double exposure_s) {
  return level_of(machine, machine.resin.critical_dose_mj_per_cm2, exposure_s);
}

Result<SupportReport> check_supports(const PrintGeometry& print, const MachineProfile& machine,
                                     const ProgressSink& progress, std::stop_token stop) {
  Checker checker{print, machine, stop};
  report(progress, WorkStage::CheckingRegions, 0);
  if (auto ok = checker.read(); !ok) return tl::unexpected{ok.error()};
  tbb::parallel_for(std::size_t{0}, checker.all.size(), [&](std::size_t k) {
    if (stop.stop_requested()) return;
    checker.islands(k);
    checker.reach(k);
    checker.free_ends(k);
  });
  if (stop.stop_requested()) return cancelled("checking supports");
  SupportReport out;
  out.layers = static_cast<std::uint32_t>(checker.all.size());
  for (auto& found : checker.found) out.findings.insert(out.findings.end(), found.begin(), found.end());
  for (const Finding& hollow : checker.hollows().findings)
    if (hollow.kind != Finding::Kind::Island) out.findings.push_back(hollow);
  std::stable_sort(out.findings.begin(), out.findings.end(), before);
  report(progress, WorkStage::CheckingRegions, 1);
  return out;
}

}  // namespace telefab::fab
