#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/image/canvas.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kPreviewTiles = 24;
constexpr std::uint32_t kPreviewColumns = 6;
constexpr std::uint32_t kTilePx = 260;
constexpr std::uint32_t kLeastIslandPx = 4;
constexpr std::uint32_t kLayersPerBlock = 16;

/// What one layer's work leaves behind; written by index, read in order.
struct LayerWork {
  Result<void> outcome;
  std::vector<std::byte> png;
  std::vector<Contour> supports;
  Digest digest;
  LayerRuns runs;
  std::uint64_t grey_sum = 0;
  Image tile;
};

std::span<const std::byte> bytes_of(const Mask& mask) { return std::as_bytes(std::span{mask.rows}); }

/// Part and supports as one region a layer, so that where a tip enters the part nothing is counted twice.
Result<Mask> mask_of(const Layer* part, const Region& supports, const MaskFrame& frame) {
  if (supports.empty()) return part ? rasterise(part->contours, frame) : rasterise({}, frame);
  if (!part || part->contours.empty()) return rasterise(supports.to_contours(), frame);
  const auto region = Region::from_contours(part->contours);
  if (!region) return tl::unexpected{region.error()};
  return merged(rasterise(part->contours, frame), rasterise(subtract(supports, *region).to_contours(), frame));
}

/// The box of all contours; the header's may be wider by what the slicer looked through.
Bounds2 bounds_of(std::span<const Layer> layers) {
  Bounds2 all{{1e9, 1e9}, {-1e9, -1e9}};
  for (const Layer& layer : layers)
    for (const Contour& ring : layer.contours) {
      const Bounds2 b = ring.bounds();
      all.min = {std::min(all.min.x_mm, b.min.x_mm), std::min(all.min.y_mm, b.min.y_mm)};
      all.max = {std::max(all.max.x_mm, b.max.x_mm), std::max(all.max.y_mm, b.max.y_mm)};
    }
  return all.min.x_mm <= all.max.x_mm ? all : Bounds2{};
}

Result<void> fits(const LayerStack& stack, const MachineProfile& machine, std::uint32_t print_layers) {
  const StackHeader& header = stack.header();
  const double height_mm = print_layers * header.layer_thickness_mm;
  const Bounds2 b = bounds_of(stack.layers());
  // A surface that was scaled to the whole platform leaves it by a hair; half a pixel is none a mask could show.
  const double hair_mm = machine.projection.pixel_pitch_mm / 2;
  if (b.min.x_mm < -hair_mm || b.min.y_mm < -hair_mm || b.max.x_mm > machine.platform.width_mm + hair_mm ||
      b.max.y_mm > machine.platform.depth_mm + hair_mm)
    return fail(ErrorCode::InvalidInput, fmt::format("the part reaches from ({:.2f}, {:.2f}) to ({:.2f}, {:.2f}) mm; "
                                                     "the platform of {} is {} x {} mm. Slice it for this machine",
                                                     b.min.x_mm, b.min.y_mm, b.max.x_mm, b.max.y_mm, machine.name,
                                                     machine.platform.width_mm, machine.platform.depth_mm));
  if (height_mm > machine.platform.z_travel_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the print is {:.2f} mm high with its supports; {} travels {} mm. Slice it smaller",
                            height_mm, machine.name, machine.platform.z_travel_mm));
  if (std::abs(header.layer_thickness_mm - machine.layers.thickness_mm) > 1e-9 * machine.layers.thickness_mm)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format(
            "the layers are {} mm thick; {} exposes layers of {} mm. Slice it for this machine, or change its profile",
            header.layer_thickness_mm, machine.name, machine.layers.thickness_mm));
  return {};
}

std::chrono::microseconds exposure_of(const MachineProfile& machine, std::uint32_t print_layer) {
  const double seconds =
      print_layer < machine.layers.bottom_count ? machine.layers.bottom_exposure_s : machine.layers.exposure_s;
  return std::chrono::microseconds{std::llround(seconds * 1e6)};
}

/// The part of a mask that the whole print occupies, so that tiles show the object and not the empty platform.
struct Crop {
  std::uint32_t x = 0;
  std::uint32_t y = 0;
  std::uint32_t width = 1;
  std::uint32_t height = 1;
};

Crop crop_of(const Bounds2& bounds, const MaskFrame& frame) {
  const double margin_px = 2 + 3 / frame.pixel_pitch_mm;
  const auto clamp = [](double v, std::uint32_t most) {
    return static_cast<std::uint32_t>(std::clamp(v, 0.0, static_cast<double>(most)));
  };
  Crop crop;
  crop.x = clamp(std::floor(bounds.min.x_mm / frame.pixel_pitch_mm - margin_px), frame.size.width_px - 1);
  crop.y = clamp(std::floor(frame.size.height_px - bounds.max.y_mm / frame.pixel_pitch_mm - margin_px),
                 frame.size.height_px - 1);
  const std::uint32_t right = clamp(std::ceil(bounds.max.x_mm / frame.pixel_pitch_mm + margin_px), frame.size.width_px);
  const std::uint32_t lower =
      clamp(std::ceil(frame.size.height_px - bounds.min.y_mm / frame.pixel_pitch_mm + margin_px), frame.size.height_px);
  crop.width = std::max(1U, right > crop.x ? right - crop.x : 1U);
  crop.height = std::max(1U, lower > crop.y ? lower - crop.y : 1U);
  return crop;
}

Image cropped(const Mask& mask, const Crop& crop) {
  Image image{crop.width, crop.height, 1, {}};
  image.pixels.reserve(std::size_t{crop.width} * crop.height);
  for (std::uint32_t y = 0; y < crop.height; ++y) {
    const auto row =
        mask.rows.begin() + static_cast<std::ptrdiff_t>(std::size_t{crop.y + y} * mask.size.width_px + crop.x);
    image.pixels.insert(image.pixels.end(), row, row + crop.width);
  }
  return image;
}

/// Bounds of everything that is printed, from the contours themselves: headers may state a whole platform.
Bounds2 printed_bounds(const LayerStack& stack, const SupportPlan& supports, std::uint32_t print_layers) {
  Bounds2 all{{1e9, 1e9}, {-1e9, -1e9}};
  const auto add = [&](std::span<const Contour> rings) {
    for (const Contour& ring : rings) {
      const Bounds2 b = ring.bounds();
      all.min = {std::min(all.min.x_mm, b.min.x_mm), std::min(all.min.y_mm, b.min.y_mm)};
      all.max = {std::max(all.max.x_mm, b.max.x_mm), std::max(all.max.y_mm, b.max.y_mm)};
    }
  };
  for (const Layer& layer : stack.layers()) add(layer.contours);
  // A base is as wide at the bottom as supports ever are.
  for (std::uint32_t i = 0; i < print_layers; i += std::max(1U, print_layers / 16))
    add(supports.section(LayerIndex{i}));
  return all.min.x_mm <= all.max.x_mm ? all : Bounds2{};
}

}  // namespace

std::string_view name_of(MaskMethod method) {
  switch (method) {
    case MaskMethod::Cover:
      return "cover";
  }
  return "cover";
}

Result<MaskMethod> mask_method_from_name(std::string_view name) {
  if (name == "cover") return MaskMethod::Cover;
  return fail(ErrorCode::InvalidInput, fmt::format("{} is no way to make masks; there is: cover", name));
}

Result<void> PlanOptions::validate() const {
  if (threads < 0 || threads > 1024)
    return fail(ErrorCode::InvalidInput, fmt::format("{} threads; 0 (all cores) to 1024 are possible", threads));
  return supports.validate();
}

double layer_seconds(const MachineProfile::Motion& motion, std::chrono::microseconds exposure) {
  return std::chrono::duration<double>(exposure).count() + motion.lift_mm / motion.lift_speed_mm_per_s +
         motion.lift_mm / motion.lower_speed_mm_per_s + motion.settle_s;
}

Result<PlanSummary> plan_job(const LayerStack& stack, const MachineProfile& machine, const PlanOptions& options,
                             const PlanSink& sink, const Clock& clock, const ProgressSink& progress,
                             std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  const StackHeader& header = stack.header();
  if (auto ok = fits(stack, machine, header.layer_count); !ok) return tl::unexpected{ok.error()};

  const Nanoseconds begun = clock.now();
  SupportOptions support_options = options.supports;
  support_options.threads = options.threads;
  const auto supports = plan_supports(stack.layers(), header, machine, support_options, progress, stop);
  if (!supports) return tl::unexpected{supports.error()};
  const Nanoseconds supported = clock.now();

  PlanSummary summary;
  summary.part_layers = header.layer_count;
  summary.lift_layers = supports->lift_layers();
  summary.figures = supports->figures();
  summary.anchors = supports->anchors().size();
  summary.supports_json = to_json(*supports);
  const std::uint32_t print_layers = summary.part_layers + summary.lift_layers;
  if (auto ok = fits(stack, machine, print_layers); !ok) return tl::unexpected{ok.error()};

  const MaskFrame frame = mask_frame(machine);
  const Crop crop = crop_of(printed_bounds(stack, *supports, print_layers), frame);
  const std::uint32_t tiles = std::min(kPreviewTiles, print_layers);
  std::vector<std::uint32_t> tile_layers;
  for (std::uint32_t t = 0; t < tiles; ++t)
    tile_layers.push_back(tiles == 1 ? 0
                                     : static_cast<std::uint32_t>(std::uint64_t{t} * (print_layers - 1) / (tiles - 1)));
  std::vector<Image> tile_images;
  std::vector<std::string> tile_labels;

  PrintPlan& plan = summary.plan;
  plan.job = options.job;
  plan.machine = machine.name;
  plan.mask_size = frame.size;
  plan.motion = machine.motion;
  plan.z_travel_mm = machine.platform.z_travel_mm;

  const std::uint8_t cured_from = cure_level(machine);
  MaskWatch watch{frame.pixel_pitch_mm, kLeastIslandPx};
  const auto work_on = [&](std::uint32_t print_layer) {
    LayerWork work;
    const Layer* part =
        print_layer >= summary.lift_layers ? &stack.layers()[print_layer - summary.lift_layers] : nullptr;
    const Region section = supports->section_region(LayerIndex{print_layer});
    auto mask = mask_of(part, section, frame);
    if (!mask) {
      work.outcome = tl::unexpected{mask.error()};
      return work;
    }
    auto png = encode_png_grey(frame.size.width_px, frame.size.height_px, mask->rows);
    if (!png) {
      work.outcome = tl::unexpected{png.error()};
      return work;
    }
    work.png = std::move(*png);
    work.supports = section.to_contours();
    work.digest = digest_of(bytes_of(*mask));
    work.runs = LayerRuns::from_mask(mask->view(), cured_from);
    for (const std::uint8_t level : mask->rows) work.grey_sum += level;
    if (std::binary_search(tile_layers.begin(), tile_layers.end(), print_layer)) work.tile = cropped(*mask, crop);
    return work;
  };

  tbb::task_arena arena{options.threads == 0 ? tbb::task_arena::automatic : options.threads};
  const double voxel_mm3 = frame.pixel_pitch_mm * frame.pixel_pitch_mm * header.layer_thickness_mm;
  std::vector<LayerWork> block;
  for (std::uint32_t first = 0; first < print_layers; first += kLayersPerBlock) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "planning was cancelled");
    const std::uint32_t count = std::min(kLayersPerBlock, print_layers - first);
    block.assign(count, {});
    arena.execute(
        [&] { tbb::parallel_for(std::uint32_t{0}, count, [&](std::uint32_t i) { block[i] = work_on(first + i); }); });
    for (std::uint32_t i = 0; i < count; ++i) {
      LayerWork& work = block[i];
      if (!work.outcome) return tl::unexpected{work.outcome.error()};
      const LayerIndex index{first + i};
      if (auto done = sink({index, work.png, work.supports}); !done) return tl::unexpected{done.error()};
      PlannedLayer planned;
      planned.index = index;
      planned.z_mm = (index.count() + 1) * header.layer_thickness_mm;
      planned.exposure = work.grey_sum == 0 ? std::chrono::microseconds{0} : exposure_of(machine, index.count());
      planned.mask = work.digest;
      const double lit_mm2 = static_cast<double>(work.grey_sum) / 255 * frame.pixel_pitch_mm * frame.pixel_pitch_mm;
      if (lit_mm2 > summary.peel.most_mm2) summary.peel = {lit_mm2, index};
      summary.cured_mm3 += static_cast<double>(work.grey_sum) / 255 * voxel_mm3;
      summary.exposure_s += std::chrono::duration<double>(planned.exposure).count();
      summary.print_s += layer_seconds(machine.motion, planned.exposure);
      plan.layers.push_back(planned);
      if (!work.tile.pixels.empty()) {
        tile_images.push_back(std::move(work.tile));
        tile_labels.push_back(fmt::format("layer {}  z {:.2f} mm", index.count(), planned.z_mm));
      }
      if (auto watched = watch.add(std::move(work.runs)); !watched) return tl::unexpected{watched.error()};
    }
    report(progress, "making masks", static_cast<double>(first + count) / print_layers);
  }
  summary.check = watch.finish();
  summary.preview = contact_sheet(tile_images, tile_labels, kPreviewColumns, kTilePx);
  if (auto ok = plan.validate(); !ok) return tl::unexpected{ok.error()};
  summary.support_seconds = std::chrono::duration<double>(supported - begun).count();
  summary.mask_seconds = std::chrono::duration<double>(clock.now() - supported).count();
  return summary;
}

std::string to_json(const PlanSummary& s) {
  using nlohmann::ordered_json;
  const ordered_json value{{"job", s.plan.job},
                           {"machine", s.plan.machine},
                           {"mask_px", {s.plan.mask_size.width_px, s.plan.mask_size.height_px}},
                           {"layers", s.plan.layers.size()},
                           {"part_layers", s.part_layers},
                           {"lift_layers", s.lift_layers},
                           {"anchors", s.anchors},
                           {"to_support_mm2", s.figures.to_support_mm2},
                           {"part_mm3", s.figures.part_mm3},
                           {"support_mm3", s.figures.support_mm3},
                           {"cured_mm3", s.cured_mm3},
                           {"exposure_s", s.exposure_s},
                           {"print_s", s.print_s},
                           {"plan_digest", to_hex(plan_digest(s.plan))},
                           {"check", ordered_json::parse(to_json(s.check))},
                           {"seconds", {{"supports", s.support_seconds}, {"masks", s.mask_seconds}}}};
  return value.dump(1) + "\n";
}

}  // namespace telefab::fab
