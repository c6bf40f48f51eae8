// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/fab/formats/contour_import.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/geometry/contour_lines.hpp>

#include "cli_reader.hpp"
#include "raw_layers.hpp"
#include "ring_nesting.hpp"
#include "svg_reader.hpp"
#include "threemf_reader.hpp"

namespace telefab::fab {
namespace {

/// What numbers of single precision may be off at the rim of a platform; such vertices are moved onto it.
constexpr double kRimRounding = 1e-3;

std::string_view text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

Result<RawLayers> read_lines(std::string_view text, double thickness_mm) {
  RawLayers raw;
  const auto read = read_json_lines(text, [&](const Layer& layer) -> Result<void> {
    auto to = raw.at(layer.z_mm + thickness_mm / 2);
    if (!to) return tl::unexpected{to.error()};
    for (const Contour& ring : layer.contours)
      if (auto ok = RawLayers::add(**to, {1, ring.is_hole(), {ring.vertices().begin(), ring.vertices().end()}}); !ok)
        return ok;
    return {};
  });
  if (!read) return tl::unexpected{read.error()};
  return raw;
}

Result<RawLayers> read_raw(ImportFormat format, std::span<const std::byte> bytes, const ImportOptions& options,
                           double thickness_mm) {
  switch (format) {
    case ImportFormat::Cli:
      return read_cli(text_of(bytes), options.unit_mm);
    case ImportFormat::Svg:
      return read_svg(text_of(bytes), options.unit_mm);
    case ImportFormat::ThreeMf:
      return read_threemf(bytes, options.unit_mm);
    case ImportFormat::JsonLines:
      return read_lines(text_of(bytes), thickness_mm);
  }
  return fail(ErrorCode::Internal, "a contour format without a reader");
}

/// Every layer as thick as the machine's, none missing. Returns the lower side of the lowest.
Result<double> check_heights(const RawLayers& raw, const MachineProfile& machine) {
  const double t = machine.layers.thickness_mm;
  const double tolerance = t / 50;
  const double first_top = raw.layers().begin()->second.top_mm;
  const double bottom = raw.bottom_mm.value_or(first_top - t);
  double below = bottom;
  std::uint32_t number = 0;
  for (const auto& [key, layer] : raw.layers()) {
    const double thickness = layer.top_mm - below;
    if (std::abs(thickness - t) > tolerance)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer {} reaches from {:.4f} to {:.4f} mm, {:.4f} mm; {} exposes layers of {} mm. Slice "
                              "it for this machine, or change its profile",
                              number, below, layer.top_mm, thickness, machine.name, t));
    ++number;
    if (std::abs(layer.top_mm - (bottom + number * t)) > t / 4)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer {} lies {:.4f} mm off from layers of {} mm; slice it for {}", number - 1,
                              layer.top_mm - (bottom + number * t), t, machine.name));
    below = layer.top_mm;
  }
  return bottom;
}

/// No two neighbours equal to the nanometre, so that nothing exact is decided on rounding.
std::vector<Point2> without_repeats(const std::vector<Point2>& ring) {
  const auto same = [](Point2 a, Point2 b) {
    return std::llround(a.x_mm * 1e6) == std::llround(b.x_mm * 1e6) &&
           std::llround(a.y_mm * 1e6) == std::llround(b.y_mm * 1e6);
  };
  std::vector<Point2> out;
  for (const Point2 p : ring)
    if (out.empty() || !same(out.back(), p)) out.push_back(p);
  while (out.size() > 1 && same(out.front(), out.back())) out.pop_back();
  return out;
}

Result<Region> even_odd(const std::vector<std::vector<Point2>>& rings) {
  std::vector<GridRing> grid;
  for (const auto& ring : rings) {
    GridRing& to = grid.emplace_back();
    for (const Point2 p : ring) to.push_back(to_grid(p));
  }
  return Region::from_rings(grid, true);
}

/// The rings of one part in one layer, in our directions.
Result<std::vector<Contour>> contours_of_rings(std::vector<std::vector<Point2>> rings,
                                               const std::vector<std::optional<bool>>& holes, ImportReport& report,
                                               bool& rebuilt) {
  const auto order = order_rings(rings);
  if (!order) return tl::unexpected{order.error()};
  if (order->crossing)
    return fail(ErrorCode::InvalidInput,
                fmt::format("contours cross at ({:.4f}, {:.4f}) mm; repair the part where it was sliced",
                            order->crossing->x_mm, order->crossing->y_mm));
  if (order->touches) {
    rebuilt = true;
    const auto region = even_odd(rings);
    if (!region) return tl::unexpected{region.error()};
    return region->to_contours();
  }
  std::vector<Contour> contours;
  for (std::size_t i = 0; i < rings.size(); ++i) {
    const bool hole = order->depth[i] % 2 != 0;
    const bool clockwise = signed_area_mm2(rings[i]) < 0;
    if (holes[i].value_or(clockwise) != hole) ++report.turned_rings;
    if (clockwise != hole) std::reverse(rings[i].begin(), rings[i].end());
    auto contour = Contour::from_vertices(std::move(rings[i]));
    if (!contour) return tl::unexpected{contour.error()};
    contours.push_back(std::move(*contour));
  }
  return contours;
}

Result<std::vector<Contour>> contours_of_layer(RawLayer& layer, Point2 shift, const MachineProfile::Platform& platform,
                                               ImportReport& report) {
  struct Part {
    std::vector<std::vector<Point2>> rings;
    std::vector<std::optional<bool>> holes;
  };
  std::map<std::uint32_t, Part> parts;
  for (RawRing& raw : layer.rings) {
    for (Point2& p : raw.vertices)
      p = {std::clamp(p.x_mm + shift.x_mm, 0.0, platform.width_mm),
           std::clamp(p.y_mm + shift.y_mm, 0.0, platform.depth_mm)};
    auto ring = without_repeats(raw.vertices);
    if (ring.size() < 3) {
      ++report.dropped_rings;
      continue;
    }
    parts[raw.part].rings.push_back(std::move(ring));
    parts[raw.part].holes.push_back(raw.hole);
  }
  bool rebuilt = false;
  std::vector<std::vector<Contour>> parts_made;
  for (auto& [id, part] : parts) {
    auto contours = contours_of_rings(std::move(part.rings), part.holes, report, rebuilt);
    if (!contours) return contours;
    if (!contours->empty()) parts_made.push_back(std::move(*contours));
  }
  if (parts_made.size() > 1) {
    rebuilt = true;
    std::vector<Region> regions;
    for (const auto& contours : parts_made) {
      auto region = Region::from_contours(contours);
      if (!region) return tl::unexpected{region.error()};
      regions.push_back(std::move(*region));
    }
    parts_made = {unite(regions).to_contours()};
  }
  report.rebuilt_layers += rebuilt;
  if (parts_made.empty()) return std::vector<Contour>{};
  return sorted_canonically(std::move(parts_made.front()));
}

/// How far everything moves to lie on the platform.
Result<Point2> find_place(const RawLayers& raw, const MachineProfile& machine, bool centre) {
  Bounds2 b = Bounds2::nothing();
  for (const auto& [key, layer] : raw.layers())
    for (const RawRing& ring : layer.rings)
      for (const Point2 p : ring.vertices) b.include(p);
  if (b.is_nothing()) return fail(ErrorCode::InvalidInput, "there is no closed contour in any layer");
  const auto& platform = machine.platform;
  Point2 shift;
  if (centre)
    shift = {(platform.width_mm - b.min.x_mm - b.max.x_mm) / 2, (platform.depth_mm - b.min.y_mm - b.max.y_mm) / 2};
  const auto inside = [&](double low, double high, double size) {
    return low >= -kRimRounding && high <= size + kRimRounding;
  };
  if (inside(b.min.x_mm + shift.x_mm, b.max.x_mm + shift.x_mm, platform.width_mm) &&
      inside(b.min.y_mm + shift.y_mm, b.max.y_mm + shift.y_mm, platform.depth_mm))
    return shift;
  const bool small_enough = b.width_mm() <= platform.width_mm && b.depth_mm() <= platform.depth_mm;
  return fail(
      ErrorCode::InvalidInput,
      fmt::format("the part reaches from ({:.3f}, {:.3f}) to ({:.3f}, {:.3f}) mm; the platform of {} is {} x {} "
                  "mm. {}",
                  b.min.x_mm, b.min.y_mm, b.max.x_mm, b.max.y_mm, machine.name, platform.width_mm, platform.depth_mm,
                  small_enough ? "Say --place centre, or move it" : "Make it smaller, or check its unit"));
}

}  // namespace

std::string_view name_of(ImportFormat format) {
  constexpr std::array<std::string_view, 4> names{"CLI", "SVG", "3MF", "JSON lines"};
  return names[static_cast<std::size_t>(format)];
}

std::optional<ImportFormat> import_format_of(std::span<const std::byte> bytes) {
  const auto head = text_of(bytes.first(std::min<std::size_t>(bytes.size(), 4096)));
  if (head.starts_with("PK\x03\x04")) return ImportFormat::ThreeMf;
  const auto first = head.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string_view::npos) return std::nullopt;
  if (head[first] == '{') return ImportFormat::JsonLines;
  if (head[first] == '<' && head.find("<svg") != std::string_view::npos) return ImportFormat::Svg;
  if (head.find("$$HEADERSTART") != std::string_view::npos) return ImportFormat::Cli;
  return std::nullopt;
}

Result<void> ImportOptions::validate() const {
  if (unit_mm && (!(*unit_mm > 0) || !(*unit_mm <= 1000)))
    return fail(ErrorCode::InvalidInput, fmt::format("a unit of {} mm; it must lie in (0, 1000]", *unit_mm));
  return {};
}

Result<Import> import_contours(std::span<const std::byte> bytes, const MachineProfile& machine,
                               const ImportOptions& options, const ProgressSink& progress, std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  const auto format = import_format_of(bytes);
  if (!format)
    return fail(ErrorCode::InvalidInput, "this is none of the files that are read: .tfc, CLI, SVG, 3MF, JSON lines");
  const double thickness_mm = machine.layers.thickness_mm;
  report(progress, WorkStage::ReadingContours, 0);
  auto raw = read_raw(*format, bytes, options, thickness_mm);
  if (!raw) return tl::unexpected{raw.error()};
  if (raw->layers().empty())
    return fail(ErrorCode::InvalidInput, *format == ImportFormat::Svg ? "there is no layer: no group has a slic3r:z"
                                                                      : "there is no layer in the file");
  const auto bottom = check_heights(*raw, machine);
  if (!bottom) return tl::unexpected{bottom.error()};
  const auto shift = find_place(*raw, machine, options.centre);
  if (!shift) return tl::unexpected{shift.error()};

  ImportReport done;
  done.format = *format;
  done.skipped_hatches = raw->skipped_hatches;
  done.heights_in_millionths = raw->heights_in_millionths;
  done.lowered_mm = *bottom;
  StackHeader header;
  header.machine = machine.name;
  header.layer_thickness_mm = thickness_mm;
  header.pixel_pitch_mm = machine.projection.pixel_pitch_mm;
  header.layer_count = static_cast<std::uint32_t>(raw->layers().size());
  header.scan_name = options.name.substr(0, 256);
  header.bounds = {{0, 0}, {machine.platform.width_mm, machine.platform.depth_mm}};
  std::vector<Layer> layers;
  for (auto& [key, from] : raw->layers()) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "the import was cancelled; nothing was written");
    Layer layer;
    layer.index = LayerIndex{static_cast<std::uint32_t>(layers.size())};
    layer.z_mm = cut_height_mm(layer.index, thickness_mm);
    auto contours = contours_of_layer(from, *shift, machine.platform, done);
    if (!contours)
      return fail_in(fmt::format("layer {} (top at {:.4f} mm)", layers.size(), from.top_mm), contours.error());
    from.rings = {};
    layer.contours = std::move(*contours);
    for (const Contour& ring : layer.contours) {
      layer.certificate.measured_euler += ring.is_hole() ? -1 : 1;
      done.vertices += ring.vertices().size();
    }
    done.rings += layer.contours.size();
    layers.push_back(std::move(layer));
    report(progress, WorkStage::SortingContours, static_cast<double>(layers.size()) / header.layer_count);
  }
  if (done.rings == 0)
    return fail(ErrorCode::InvalidInput,
                fmt::format("none of the {} layers has a ring that encloses anything; there is nothing to print",
                            header.layer_count));
  auto stack = LayerStack::from_layers(std::move(header), std::move(layers));
  if (!stack) return tl::unexpected{stack.error()};
  return Import{std::move(*stack), done};
}

}  // namespace telefab::fab
