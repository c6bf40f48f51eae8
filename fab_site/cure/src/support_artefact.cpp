// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <telefab/image/canvas.hpp>

#include "support_specimens.hpp"

namespace telefab::fab {
namespace {

using Kind = SupportSpecimen::Kind;
using Rings = std::vector<Contour>;

constexpr double kPostOfNeck = 3;
constexpr std::uint32_t kMapWidth_px = 1600;
constexpr double kKilo = 1000;  ///< kPa * mm2 = mN

PixelSet rectangle(int left, int front, int right, int back) {
  PixelSet set{left, front, right - left, back - front};
  for (int y = 0; y < back - front; ++y)
    for (int x = 0; x < right - left; ++x) set.add(x, y);
  return set;
}

/// A disc's pixels by the square of how far their middles are from the nearest neck's.
class NeckDistances {
 public:
  explicit NeckDistances(const PlacedSpecimen& placed)
      : at_{placed.at},
        reach_{placed.disc.radius_px + 1},
        squares_px2_(static_cast<std::size_t>(width()) * static_cast<std::size_t>(width()),
                     std::numeric_limits<double>::infinity()) {
    const DiscShape& disc = placed.disc;
    const double half = disc.odd ? 0 : 0.5;
    for (int y = -reach_; y <= reach_; ++y)
      for (int x = -reach_; x <= reach_; ++x) {
        if (!within(disc.odd, x, y, disc.radius_px)) continue;
        double& least = squares_px2_[place(x + reach_, y + reach_)];
        for (const PixelPlace neck : disc.necks()) {
          const double dx = x - neck.x + half, dy = y - neck.y + half;
          least = std::min(least, dx * dx + dy * dy);
        }
      }
  }
  [[nodiscard]] PixelSet within_px(double radius_px) const {
    PixelSet set{at_.x - reach_, at_.y - reach_, width(), width()};
    for (int y = 0; y < width(); ++y)
      for (int x = 0; x < width(); ++x)
        if (squares_px2_[place(x, y)] <= radius_px * radius_px) set.add(x, y);
    return set;
  }

 private:
  [[nodiscard]] int width() const { return 2 * reach_ + 1; }
  [[nodiscard]] std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width()) + static_cast<std::size_t>(x);
  }
  PixelPlace at_;
  int reach_;
  std::vector<double> squares_px2_;
};

/// How far from its necks a disc reaches in a layer of the print.
double radius_in(const PlacedSpecimen& placed, const SupportLayout& layout, int layer) {
  const double neck = placed.disc.neck_radius_px;
  const int full = layout.layers - layout.disc_layers, cone = full - placed.disc.cone_layers(layout.layer_px);
  if (layer >= full) return 4.0 * placed.disc.radius_px;
  if (layer >= cone) return neck + (layer - cone + 1) * layout.layer_px;
  return layer >= cone - layout.neck_layers ? neck : kPostOfNeck * neck;
}

PixelSet shelf_in(const PlacedSpecimen& placed, const SupportLayout& layout, int layer) {
  const ShelfShape& s = placed.shelf;
  const int jump = layer >= layout.layers - layout.upright_layers ? s.overhang_px : 0;
  return rectangle(placed.at.x, placed.at.y, placed.at.x + s.wall_px + jump, placed.at.y + s.width_px);
}

/// What decides a specimen's rings in a layer: layers of the same value have the same.
double state_in(const PlacedSpecimen& placed, const SupportLayout& layout, int layer) {
  return placed.specimen.kind == Kind::Shelf ? (layer >= layout.layers - layout.upright_layers ? 1 : 0)
                                             : radius_in(placed, layout, layer);
}

/// Of every layer above the block.
Result<std::vector<Rings>> rings_of(const PlacedSpecimen& placed, const SupportLayout& layout, double pitch_mm) {
  std::vector<Rings> out;
  const bool shelf = placed.specimen.kind == Kind::Shelf;
  const NeckDistances necks{placed};
  for (int i = layout.block_layers; i < layout.layers; ++i) {
    if (i > layout.block_layers && state_in(placed, layout, i) == state_in(placed, layout, i - 1)) {
      out.push_back(out.back());
      continue;
    }
    auto rings = (shelf ? shelf_in(placed, layout, i) : necks.within_px(radius_in(placed, layout, i))).rings(pitch_mm);
    if (!rings) return tl::unexpected{rings.error()};
    out.push_back(std::move(*rings));
  }
  return out;
}

Result<LayerStack> stack_of(const SupportLayout& layout, const MachineProfile& machine) {
  const double pitch = machine.projection.pixel_pitch_mm;
  const auto count = static_cast<std::uint32_t>(layout.layers);
  StackHeader header;
  header.machine = machine.name;
  header.layer_thickness_mm = machine.layers.thickness_mm;
  header.pixel_pitch_mm = pitch;
  header.layer_count = count;
  header.scan_name = "supports";
  header.bounds = {{layout.block_left * pitch, layout.block_front * pitch},
                   {layout.block_right * pitch, layout.block_back * pitch}};
  std::vector<Layer> layers(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    layers[i].index = LayerIndex{i};
    layers[i].z_mm = cut_height_mm(layers[i].index, header.layer_thickness_mm);
  }
  const auto block =
      rectangle(layout.block_left, layout.block_front, layout.block_right, layout.block_back).rings(pitch);
  if (!block) return tl::unexpected{block.error()};
  for (int i = 0; i < layout.block_layers; ++i) layers[static_cast<std::size_t>(i)].contours = *block;
  std::vector<Result<std::vector<Rings>>> drawn(layout.specimens.size());
  tbb::parallel_for(std::size_t{0}, drawn.size(),
                    [&](std::size_t i) { drawn[i] = rings_of(layout.specimens[i], layout, pitch); });
  for (auto& of_specimen : drawn) {
    if (!of_specimen) return tl::unexpected{of_specimen.error()};
    for (std::size_t i = 0; i < of_specimen->size(); ++i) {
      Rings& into = layers[static_cast<std::size_t>(layout.block_layers) + i].contours;
      into.insert(into.end(), (*of_specimen)[i].begin(), (*of_specimen)[i].end());
    }
  }
  for (Layer& layer : layers) {
    for (const Contour& ring : layer.contours) header.bounds.include(ring.bounds());
    layer.contours = sorted_canonically(std::move(layer.contours));
  }
  return LayerStack::from_layers(std::move(header), std::move(layers));
}

Image map_of(const SupportLayout& layout, const MachineProfile& machine) {
  constexpr Colour kPaper{255, 255, 255}, kInk{20, 20, 20}, kBlock{225, 225, 225}, kDisc{170, 200, 235},
      kMoved{240, 205, 150}, kShelf{175, 220, 175}, kNeck{60, 60, 60};
  const double platform_w = machine.platform.width_mm, platform_d = machine.platform.depth_mm;
  const double scale = kMapWidth_px / platform_w,
               text_px = 0.2 * layout.disc_px * machine.projection.pixel_pitch_mm * scale;
  constexpr double kLegend_px = 60;
  const auto height = static_cast<std::uint32_t>(std::lround(platform_d * scale + kLegend_px));
  Canvas canvas{kMapWidth_px, height, kPaper};
  const auto at = [&](Point2 p) { return PixelPoint{p.x_mm * scale, (platform_d - p.y_mm) * scale}; };
  const auto box = [&](const Bounds2& b) {
    return std::vector<PixelPoint>{at(b.min), at({b.max.x_mm, b.min.y_mm}), at(b.max), at({b.min.x_mm, b.max.y_mm})};
  };
  const double pitch = machine.projection.pixel_pitch_mm;
  const std::vector<PixelPoint> block = box({{layout.block_left * pitch, layout.block_front * pitch},
                                             {layout.block_right * pitch, layout.block_back * pitch}});
  canvas.fill(std::array{block}, kBlock);
  for (const PlacedSpecimen& placed : layout.specimens) {
    const SupportSpecimen& s = placed.specimen;
    const std::string number = fmt::format("{}", s.number);
    if (s.kind == Kind::Shelf) {
      const std::vector<PixelPoint> ring = box(s.box);
      canvas.fill(std::array{ring}, kShelf);
      canvas.outline(ring, kInk, 1);
      const double edge = s.box.max.x_mm - s.overhang_mm;
      canvas.line(at({edge, s.box.min.y_mm}), at({edge, s.box.max.y_mm}), kInk, 1);
      canvas.text(at({s.box.min.x_mm + pitch, s.box.min.y_mm + pitch}), number, kInk, text_px / 2);
      continue;
    }
    const Point2 middle{(s.box.min.x_mm + s.box.max.x_mm) / 2, (s.box.min.y_mm + s.box.max.y_mm) / 2};
    canvas.disc(at(middle), placed.disc.radius_px * pitch * scale, s.kind == Kind::Ladder ? kDisc : kMoved);
    for (const PixelPlace neck : placed.disc.necks())
      canvas.disc(at({middle.x_mm + neck.x * pitch, middle.y_mm + neck.y * pitch}),
                  placed.disc.neck_radius_px * pitch * scale, kNeck);
    // Below the necks, wherever they were moved.
    const PixelPoint text = at({middle.x_mm, middle.y_mm - 0.65 * placed.disc.radius_px * pitch});
    canvas.text({text.x_px - 0.4 * text_px * static_cast<double>(number.size()), text.y_px + 0.4 * text_px}, number,
                kInk, text_px);
  }
  canvas.outline(std::array{PixelPoint{0, 0}, PixelPoint{kMapWidth_px - 1.0, 0},
                            PixelPoint{kMapWidth_px - 1.0, platform_d * scale}, PixelPoint{0, platform_d * scale}},
                 kInk, 2);
  canvas.text({10, height - 20.0},
              "as printed, from above, front below; blue: ladder, orange: off centre, green: shelves", kInk, 22);
  return canvas.image();
}

std::string csv_of(const SupportLayout& layout, const MachineProfile& machine) {
  std::string csv = "machine,test,number,demand,overhang_mm,held\n";
  for (const PlacedSpecimen& placed : layout.specimens) {
    const SupportSpecimen& s = placed.specimen;
    csv += s.kind == Kind::Shelf
               ? fmt::format("{},{},{},,{:.6g},\n", machine.name, name_of(s.kind), s.number, s.overhang_mm)
               : fmt::format("{},{},{},{:.6g},,\n", machine.name, name_of(s.kind), s.number, s.demand);
  }
  return csv;
}

std::string readme_of(const SupportPrint& print, const SupportLayout& layout, const MachineProfile& machine) {
  const double kpa = machine.pull_of_film_kpa();
  double least = INFINITY, most = 0;
  std::size_t ladder = 0;
  for (const SupportSpecimen& s : print.specimens) {
    if (s.kind != Kind::Ladder) continue;
    ++ladder;
    least = std::min(least, s.demand);
    most = std::max(most, s.demand);
  }
  const double discs_mm2 = static_cast<double>(ladder + 3) * print.disc_mm * print.disc_mm * 0.785;
  return fmt::format(
      "# What carries on {0} with {1}\n\n"
      "Discs of {2:.2f} mm ({3} pixels{4}) on three necks each, {5} steps twice, mixed: their necks bear {6:.0f} to "
      "{7:.0f} times the pull of the film. Three discs more stand beside the middle of their necks. Walls jump "
      "outwards in one layer and go straight up from there. **Some of it is to tear.**\n\n"
      "1. Plan it without supports and print it with a film and resin as you use them. The plan will say that it does "
      "not carry (`carry`); print it all the same:\n\n"
      "       telefab-fab plan supports.tfc --machine {0} --supports none --masks cover --out plan\n\n"
      "   At {8:g} kPa the block, {9:.0f} mm2, is pulled with {10:.0f} N, and all discs together with {11:.0f} N. "
      "Where "
      "your machine's axis, screws or film bear less, do not print it.\n"
      "2. What tears stays on the film; discs come last so that nothing is printed onto it. **Empty the vat and look "
      "at "
      "the film before you print again.**\n"
      "3. Hold the platform as map.png shows it: as printed, seen from above, the front below. (Of a part that hangs "
      "on a platform turned over, left and right are exchanged.) Look at each number.\n"
      "4. Write into supports.csv, column held:\n\n"
      "| test | yes | no |\n|---|---|---|\n"
      "| ladder, off-centre | the disc is whole and on all its necks | it is missing, or a neck has torn or come off "
      "|\n"
      "| shelf | the jump is whole and straight | it is missing, bent or frayed |\n\n"
      "   Delete the row of what you cannot tell.\n"
      "5. Let the figures be fitted, and put what is printed into the profile:\n\n"
      "       telefab-fab calibrate supports --read supports.csv --machine {0} --out supports.toml\n\n"
      "Use the profile that it was printed with. Note beside it film, speed of the lift, temperature, and layers since "
      "the film was new: they all change the pull.\n",
      machine.name, machine.resin.name, print.disc_mm, layout.disc_px,
      layout.disc_px < 200 ? "; 200 do not fit on this platform" : "", ladder / 2, least, most, kpa, print.block_mm2,
      print.block_mm2 * kpa / kKilo, discs_mm2 * kpa / kKilo);
}

}  // namespace

Result<SupportPrint> support_print(const MachineProfile& machine) {
  const auto layout = support_layout(machine);
  if (!layout) return tl::unexpected{layout.error()};
  auto stack = stack_of(*layout, machine);
  if (!stack) return tl::unexpected{stack.error()};
  const double pitch = machine.projection.pixel_pitch_mm;
  SupportPrint out{
      std::move(*stack),
      {},
      csv_of(*layout, machine),
      {},
      map_of(*layout, machine),
      layout->disc_px * pitch,
      (layout->block_right - layout->block_left) * pitch * (layout->block_back - layout->block_front) * pitch};
  for (const PlacedSpecimen& placed : layout->specimens) out.specimens.push_back(placed.specimen);
  out.readme = readme_of(out, *layout, machine);
  return out;
}

}  // namespace telefab::fab
