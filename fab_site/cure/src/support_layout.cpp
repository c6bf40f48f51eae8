// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "support_specimens.hpp"

namespace telefab::fab {
namespace {

using Kind = SupportSpecimen::Kind;

constexpr double kLeastDemand = 30, kMostDemand = 850, kStep = 1.25;
constexpr int kLeastNeck_px = 12;  ///< area of one that is 4 pixels wide, its corners cut
constexpr int kMostDisc_px = 200, kLeastDisc_px = 64, kDiscStep_px = 8;
constexpr int kGap_px = 16, kEdge_px = 4;
constexpr int kNeckLayers = 5, kDiscLayers = 4, kLeastPostLayers = 10;
constexpr std::array<double, 3> kOffsets{0.1, 0.2, 0.3};  ///< of the radius
constexpr std::array<int, 8> kOverhangs_layers{2, 3, 4, 5, 6, 8, 10, 12};
constexpr double kShelfWidth_mm = 5, kUpright_mm = 2, kBlock_mm = 1;
constexpr std::uint64_t kMixing = 19;  ///< any number: which disc stands where

int area_px(bool odd, double radius_px) {
  int area = 0;
  const int reach = static_cast<int>(radius_px) + 1;
  for (int y = -reach; y <= reach; ++y)
    for (int x = -reach; x <= reach; ++x) area += within(odd, x, y, radius_px) ? 1 : 0;
  return area;
}

/// The disc whose necks come nearest to an area of `wanted_px` each; about a pixel's middle or a corner of four.
DiscShape disc_with_necks(int disc_px, double wanted_px) {
  DiscShape best;
  double least = std::numeric_limits<double>::infinity();
  const double about = std::sqrt(wanted_px / std::numbers::pi);
  for (const bool odd : {false, true})
    for (double radius = std::max(1.0, about - 1.5); radius < about + 1.5; radius += 0.02) {
      const int area = area_px(odd, radius);
      const double off = std::abs(std::log(area / wanted_px));
      if (area < kLeastNeck_px || off >= least - 1e-12) continue;
      least = off;
      best = {odd, disc_px / 2, 0, radius, 0, area};
    }
  best.disc_area_px = area_px(best.odd, best.radius_px);
  return best;
}

std::vector<DiscShape> ladder_of(int disc_px) {
  std::vector<DiscShape> steps;
  const double disc_area = area_px(false, disc_px / 2.0);
  for (double demand = kLeastDemand; demand <= kMostDemand; demand *= kStep) {
    const double wanted = disc_area / (3 * demand);
    if (wanted < kLeastNeck_px) break;
    steps.push_back(disc_with_necks(disc_px, wanted));
  }
  return steps;
}

std::vector<DiscShape> off_centre_of(int disc_px, const std::vector<DiscShape>& ladder) {
  const double middle = kLeastDemand * std::pow(kStep, static_cast<double>(ladder.size() / 2));
  std::vector<DiscShape> discs;
  for (const double share : kOffsets) {
    DiscShape disc = disc_with_necks(disc_px, area_px(false, disc_px / 2.0) / (3 * middle / 2));
    disc.moved_px = static_cast<int>(std::lround(share * disc.radius_px));
    discs.push_back(disc);
  }
  return discs;
}

/// Jumps in whole pixels; those that come out alike are one.
std::vector<int> overhangs_px(double layer_px) {
  std::vector<int> out;
  for (const int layers : kOverhangs_layers) {
    const int px = static_cast<int>(std::lround(layers * layer_px));
    if (px > 0 && (out.empty() || px > out.back())) out.push_back(px);
  }
  return out;
}

/// Cells of a disc each, the last ones for shelves, two side by side in a row of a cell.
struct Grid {
  int cell_px = 0, columns = 0, rows = 0;
  ShelfShape shelf;  ///< the largest
  int shelf_rows = 0;

  [[nodiscard]] int shelf_cells(std::size_t shelves) const {
    const int each = 2 * shelf_rows;
    return each == 0 ? std::numeric_limits<int>::max() / 4 : (static_cast<int>(shelves) + each - 1) / each;
  }
};

Grid grid_of(const MachineProfile& machine, int disc_px, const std::vector<int>& overhangs) {
  const PixelSize size = machine.mask_size();
  Grid grid;
  grid.cell_px = disc_px + kGap_px;
  grid.columns = (static_cast<int>(size.width_px) - 2 * kEdge_px) / grid.cell_px;
  grid.rows = (static_cast<int>(size.height_px) - 2 * kEdge_px) / grid.cell_px;
  const int longest = overhangs.empty() ? 0 : overhangs.back();
  // Shelves jump along x; a wall twice as thick as the longest jump does not bend under it.
  grid.shelf.wall_px = std::max(2 * longest, 16);
  grid.shelf.overhang_px = longest;
  const int wide = static_cast<int>(std::lround(kShelfWidth_mm / machine.projection.pixel_pitch_mm));
  grid.shelf.width_px = std::min(wide, disc_px - kGap_px);
  if (2 * (grid.shelf.wall_px + longest + kGap_px) > grid.cell_px)
    grid.shelf.wall_px = std::max(longest, grid.cell_px / 2 - longest - kGap_px);
  if (2 * (grid.shelf.wall_px + longest + kGap_px) <= grid.cell_px)
    grid.shelf_rows = grid.cell_px / (grid.shelf.width_px + kGap_px);
  return grid;
}

Bounds2 box_of(int left, int front, int right, int back, double pitch_mm) {
  return {{left * pitch_mm, front * pitch_mm}, {right * pitch_mm, back * pitch_mm}};
}

PlacedSpecimen placed_disc(const DiscShape& disc, PixelPlace middle, double pitch_mm) {
  PlacedSpecimen out;
  out.disc = disc;
  out.at = middle;
  SupportSpecimen& s = out.specimen;
  s.kind = disc.moved_px > 0 ? Kind::OffCentre : Kind::Ladder;
  s.box = box_of(middle.x - disc.radius_px, middle.y - disc.radius_px, middle.x + disc.radius_px,
                 middle.y + disc.radius_px, pitch_mm);
  s.demand = disc.demand();
  s.neck_mm2 = disc.neck_area_px * pitch_mm * pitch_mm;
  s.offset_share = static_cast<double>(disc.moved_px) / disc.radius_px;
  return out;
}

PlacedSpecimen placed_shelf(const ShelfShape& shelf, PixelPlace corner, double pitch_mm) {
  PlacedSpecimen out;
  out.shelf = shelf;
  out.at = corner;
  out.specimen.kind = Kind::Shelf;
  out.specimen.box =
      box_of(corner.x, corner.y, corner.x + shelf.wall_px + shelf.overhang_px, corner.y + shelf.width_px, pitch_mm);
  out.specimen.overhang_mm = shelf.overhang_px * pitch_mm;
  return out;
}

/// Twins far from each other and from their neighbours in the ladder, as chance has it; the same every time.
std::vector<DiscShape> mixed(std::vector<DiscShape> discs) {
  std::mt19937_64 rng{kMixing};
  for (std::size_t i = discs.size(); i > 1; --i) std::swap(discs[i - 1], discs[rng() % i]);
  return discs;
}

void place_all(SupportLayout& layout, const Grid& grid, const std::vector<DiscShape>& discs,
               const std::vector<int>& overhangs, const MachineProfile& machine) {
  const double pitch = machine.projection.pixel_pitch_mm;
  const PixelSize size = machine.mask_size();
  const int cells = static_cast<int>(discs.size()) + grid.shelf_cells(overhangs.size());
  const int rows = (cells + grid.columns - 1) / grid.columns;
  const int left = (static_cast<int>(size.width_px) - grid.columns * grid.cell_px) / 2;
  const int front = (static_cast<int>(size.height_px) - rows * grid.cell_px) / 2;
  const auto corner = [&](int cell) {
    return PixelPlace{left + cell % grid.columns * grid.cell_px, front + cell / grid.columns * grid.cell_px};
  };
  for (std::size_t i = 0; i < discs.size(); ++i) {
    const PixelPlace at = corner(static_cast<int>(i));
    layout.specimens.push_back(placed_disc(discs[i], {at.x + grid.cell_px / 2, at.y + grid.cell_px / 2}, pitch));
  }
  for (std::size_t i = 0; i < overhangs.size(); ++i) {
    const int each = 2 * grid.shelf_rows, n = static_cast<int>(i);
    const PixelPlace at = corner(static_cast<int>(discs.size()) + n / each);
    ShelfShape shelf = grid.shelf;
    shelf.overhang_px = overhangs[i];
    const int row = n % each / 2, column = n % 2;
    layout.specimens.push_back(placed_shelf(
        shelf,
        {at.x + kGap_px / 2 + column * grid.cell_px / 2, at.y + kGap_px / 2 + row * (grid.shelf.width_px + kGap_px)},
        pitch));
  }
  int number = 0;
  for (PlacedSpecimen& placed : layout.specimens) placed.specimen.number = ++number;
  layout.block_left = left;
  layout.block_front = front;
  layout.block_right = left + std::min(cells, grid.columns) * grid.cell_px;
  layout.block_back = front + rows * grid.cell_px;
}

Result<void> stack_up(SupportLayout& layout, const MachineProfile& machine) {
  const double t = machine.layers.thickness_mm;
  const auto in_layers = [&](double mm) { return static_cast<int>(std::ceil(mm / t - 1e-9)); };
  // Longer exposures of the first layers stay inside the block.
  const int bottom = static_cast<int>(machine.layers.bottom_count + machine.layers.transition_count) + 2;
  layout.block_layers = std::max(bottom, in_layers(kBlock_mm));
  layout.neck_layers = kNeckLayers;
  layout.disc_layers = kDiscLayers;
  layout.upright_layers = in_layers(kUpright_mm);
  int highest = layout.upright_layers;
  for (const PlacedSpecimen& placed : layout.specimens)
    if (placed.specimen.kind != Kind::Shelf)
      highest = std::max(highest, kNeckLayers + placed.disc.cone_layers(layout.layer_px) + kDiscLayers);
  layout.layers = layout.block_layers + kLeastPostLayers + highest;
  if (layout.layers * t > machine.platform.z_travel_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("machine {}: the print of supports would be {:.2f} mm high; the travel is {:.2f} mm",
                            machine.name, layout.layers * t, machine.platform.z_travel_mm));
  return {};
}

}  // namespace

std::array<PixelPlace, 3> DiscShape::necks() const {
  const int q = radius_px / 4, p = static_cast<int>(std::lround(q * std::numbers::sqrt3));
  return {PixelPlace{0, 2 * q - moved_px}, {-p, -q - moved_px}, {p, -q - moved_px}};
}

double DiscShape::demand() const {
  return static_cast<double>(disc_area_px) / (3.0 * neck_area_px) *
         (1 + static_cast<double>(moved_px) / (radius_px / 4));
}

int DiscShape::cone_layers(double layer_px) const {
  double farthest = 0;
  for (int y = -radius_px; y <= radius_px; ++y)
    for (int x = -radius_px; x <= radius_px; ++x) {
      if (!within(odd, x, y, radius_px)) continue;
      double nearest = std::numeric_limits<double>::infinity();
      for (const PixelPlace neck : necks()) nearest = std::min(nearest, std::hypot(x - neck.x, y - neck.y));
      farthest = std::max(farthest, nearest);
    }
  return static_cast<int>(std::ceil((farthest + 1 - neck_radius_px) / layer_px));
}

Result<SupportLayout> support_layout(const MachineProfile& machine) {
  SupportLayout layout;
  layout.layer_px = machine.layers.thickness_mm / machine.projection.pixel_pitch_mm;
  const auto overhangs = overhangs_px(layout.layer_px);
  for (int disc = kMostDisc_px; disc >= kLeastDisc_px; disc -= kDiscStep_px) {
    const auto ladder = ladder_of(disc);
    std::vector<DiscShape> discs = ladder;
    discs.insert(discs.end(), ladder.begin(), ladder.end());
    for (const DiscShape& moved : off_centre_of(disc, ladder)) discs.push_back(moved);
    const Grid grid = grid_of(machine, disc, overhangs);
    if (grid.columns * grid.rows < static_cast<int>(discs.size()) + grid.shelf_cells(overhangs.size())) continue;
    layout.disc_px = disc;
    place_all(layout, grid, mixed(std::move(discs)), overhangs, machine);
    if (auto ok = stack_up(layout, machine); !ok) return tl::unexpected{ok.error()};
    return layout;
  }
  const PixelSize size = machine.mask_size();
  return fail(ErrorCode::InvalidInput,
              fmt::format("machine {}: discs of {} pixels, each step twice, and the shelves do not fit on {} x {} "
                          "pixels",
                          machine.name, kLeastDisc_px, size.width_px, size.height_px));
}

Result<std::vector<SupportSpecimen>> support_specimens(const MachineProfile& machine) {
  const auto layout = support_layout(machine);
  if (!layout) return tl::unexpected{layout.error()};
  std::vector<SupportSpecimen> out;
  for (const PlacedSpecimen& placed : layout->specimens) out.push_back(placed.specimen);
  return out;
}

std::string_view name_of(SupportSpecimen::Kind kind) {
  switch (kind) {
    case Kind::Ladder:
      return "ladder";
    case Kind::OffCentre:
      return "off-centre";
    case Kind::Shelf:
      return "shelf";
  }
  return "";
}

}  // namespace telefab::fab
