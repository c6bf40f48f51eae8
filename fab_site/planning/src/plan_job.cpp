// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/image/canvas.hpp>

#include "layer_source.hpp"
#include "mask_passes.hpp"
#include "plan_once.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint32_t kPreviewTiles = 24;
constexpr std::uint32_t kPreviewColumns = 6;
constexpr std::uint32_t kTilePx = 260;
constexpr std::uint32_t kBlocksPerRound = 2;  // for every thread
constexpr std::uint64_t kMaskBudgetBytes = 320U << 20U;
constexpr std::uint64_t kCopiesPerMask = 3;  // the mask, the PNG before and after it is deflated

/// What one layer's work leaves behind; written by index, read in order.
struct LayerWork {
  Result<void> outcome;
  std::vector<std::byte> png;
  std::vector<Contour> supports;
  Digest digest;
  LayerRuns runs;
  LayerLight light;
  std::vector<float> at_features;  // FeatureWatch::light_of
  std::uint64_t grey_sum = 0;
  std::uint64_t solid_pixels = 0;
  Image tile;
};

std::span<const std::byte> bytes_of(const Mask& mask) { return std::as_bytes(std::span{mask.rows}); }

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
  return shrunk_to(std::move(image), kTilePx);
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

Result<PlanSummary> plan_once(const LayerStack& stack, const MachineProfile& profile, const PlanOptions& options,
                              const PlanSink& sink, const Clock& clock, const ProgressSink& progress,
                              std::stop_token stop) {
  const auto exposed = exposed_to_depth(profile, options.cure_depth_layers);
  if (!exposed) return tl::unexpected{exposed.error()};
  const MachineProfile& machine = *exposed;
  const StackHeader& header = stack.header();
  if (auto ok = fits(stack, machine, header.layer_count); !ok) return tl::unexpected{ok.error()};

  const Nanoseconds begun = clock.now();
  SupportOptions support_options = options.supports;
  support_options.threads = options.threads;
  const auto supports = options.regions
                            ? plan_supports(*options.regions, header, machine, support_options, progress, stop)
                            : plan_supports(stack.layers(), header, machine, support_options, progress, stop);
  if (!supports) return tl::unexpected{supports.error()};
  const Nanoseconds supported = clock.now();

  PlanSummary summary;
  summary.part_layers = header.layer_count;
  summary.elevation_layers = supports->elevation_layers();
  summary.figures = supports->figures();
  summary.anchors = supports->anchors().size();
  summary.supports_json = to_json(*supports);
  summary.registration_rms_mm = options.registration_rms_mm;
  summary.masks = options.masks;
  summary.mask_iterations = options.masks == MaskMethod::Cover ? 0 : options.mask_iterations;
  summary.pattern = options.pattern;
  summary.white_dose_mj_per_cm2 = machine.projection.irradiance_mw_per_cm2 * machine.layers.exposure_s;
  summary.cure_depth_mm =
      machine.resin.penetration_mm * std::log(summary.white_dose_mj_per_cm2 / machine.resin.critical_dose_mj_per_cm2);
  const std::uint32_t print_layers = summary.part_layers + summary.elevation_layers;
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
  plan.masks = options.masks;
  plan.z_travel_mm = machine.platform.z_travel_mm;

  const LayerSource source{stack, *supports};
  const auto maker = make_mask_maker(source, machine, options, clock);
  if (!maker) return tl::unexpected{maker.error()};
  MaskWatch watch{frame.pixel_pitch_mm, kLeastIslandPixels};
  auto model = cure_model(machine);
  FeatureWatch features{stack.layers(), summary.elevation_layers, frame.pixel_pitch_mm,
                        model ? std::optional{std::move(*model)} : std::nullopt};
  const auto keep = [&](LayerWork& work, std::uint32_t index, const Mask& mask) -> Result<void> {
    auto png = encode_png_grey(frame.size.width_px, frame.size.height_px, mask.rows);
    if (!png) return tl::unexpected{png.error()};
    work.png = std::move(*png);
    work.digest = digest_of(bytes_of(mask));
    work.grey_sum = sums_of(mask.rows).grey;
    if (std::binary_search(tile_layers.begin(), tile_layers.end(), index)) work.tile = cropped(mask, crop);
    const auto exposure = exposure_of(machine, index);
    work.at_features = features.light_of(index, {mask.view(), exposure});
    work.light.lit =
        LayerRuns::from_mask(mask.view(), gel_level(machine, std::chrono::duration<double>(exposure).count()));
    return {};
  };
  const auto finish = [&](MaskMaker::Made made, const std::function<void(Mask&)>& cured) {
    LayerWork work;
    work.outcome = keep(work, made.index, made.mask);
    work.supports = std::move(made.section);
    cured(made.mask);
    work.runs = LayerRuns::from_mask(made.mask.view(), kCuredPixel);
    work.light.joined = LayerRuns::from_mask(made.mask.view(), kJoinedPixel);
    work.solid_pixels = sums_of(made.mask.rows).white;
    return work;
  };

  // A speck that no pin's tip is as small as would cure on nothing: it gets no light of its own, and what later layers
  // cure of it hangs on them.
  const double tip_px = machine.supports.tip_radius_mm / frame.pixel_pitch_mm;
  const auto most_speck_px = options.supports.mode == SupportOptions::Mode::None
                                 ? 0
                                 : static_cast<std::uint64_t>(std::numbers::pi * tip_px * tip_px);
  const auto darken_specks = [&](LayerWork& work, std::uint32_t index) -> Result<void> {
    const LayerRuns specks = watch.specks(work.runs, &work.light, most_speck_px);
    if (specks.count() == 0) return {};
    auto image = decode_png(work.png, std::uint64_t{frame.size.width_px} * frame.size.height_px);
    if (!image) return tl::unexpected{image.error()};
    Mask mask{frame.size, std::move(image->pixels)};
    darken(mask, specks, work.runs);
    summary.specks += components_of(specks, true).components.size();
    return keep(work, index, mask);
  };

  // So that large masks do not fill the memory, few of them are under way at once.
  const std::uint64_t mask_bytes = std::uint64_t{frame.size.width_px} * frame.size.height_px;
  const int at_once = static_cast<int>(std::clamp<std::uint64_t>(
      kMaskBudgetBytes / (kCopiesPerMask * mask_bytes), 1,
      static_cast<std::uint64_t>(options.threads == 0 ? tbb::this_task_arena::max_concurrency() : options.threads)));
  tbb::task_arena arena{at_once};
  const double voxel_mm3 = frame.pixel_pitch_mm * frame.pixel_pitch_mm * header.layer_thickness_mm;
  const std::uint32_t in_block = (*maker)->block_layers();
  const std::uint32_t in_round = in_block * kBlocksPerRound * static_cast<std::uint32_t>(at_once);
  std::vector<LayerWork> round;
  for (std::uint32_t first = 0; first < print_layers; first += in_round) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "planning was cancelled");
    const std::uint32_t count = std::min(in_round, print_layers - first);
    const std::uint32_t blocks = (count + in_block - 1) / in_block;
    round.clear();
    round.resize(count);
    std::vector<Result<MaskFigures>> reached(blocks);
    const auto make_block = [&](std::uint32_t block) {
      const std::uint32_t from = first + block * in_block;
      const auto take = [&](MaskMaker::Made made, const std::function<void(Mask&)>& cured) -> Result<void> {
        LayerWork& work = round[made.index - first];
        work = finish(std::move(made), cured);
        return work.outcome;
      };
      reached[block] = (*maker)->make(from, std::min(in_block, first + count - from), take, stop);
    };
    arena.execute([&] {
      features.look(first + count);
      tbb::parallel_for(std::uint32_t{0}, blocks, make_block, tbb::simple_partitioner{});
    });
    for (const auto& block : reached) {
      if (!block) return tl::unexpected{block.error()};
      summary.mask_figures.add(*block);
    }
    for (std::uint32_t i = 0; i < count; ++i) {
      LayerWork& work = round[i];
      const LayerIndex index{first + i};
      if (auto done = darken_specks(work, index.count()); !done) return tl::unexpected{done.error()};
      if (auto done = sink({index, work.png, work.supports}); !done) return tl::unexpected{done.error()};
      PlannedLayer planned;
      planned.index = index;
      planned.z_mm = (index.count() + 1) * header.layer_thickness_mm;
      planned.exposure = work.grey_sum == 0 ? std::chrono::microseconds{0} : exposure_of(machine, index.count());
      planned.mask = work.digest;
      // What is solid in the end may have been lit by later layers alone; the pull is judged by the larger area.
      const double lit_mm2 =
          std::max(static_cast<double>(work.grey_sum) / 255, static_cast<double>(work.solid_pixels)) *
          frame.pixel_pitch_mm * frame.pixel_pitch_mm;
      if (lit_mm2 > summary.peel.most_mm2) summary.peel = {lit_mm2, index};
      summary.cured_mm3 += static_cast<double>(work.solid_pixels) * voxel_mm3;
      summary.exposure_s += std::chrono::duration<double>(planned.exposure).count();
      summary.print_s += layer_seconds(machine.motion, planned.exposure);
      plan.layers.push_back(planned);
      if (!work.tile.pixels.empty()) {
        tile_images.push_back(std::move(work.tile));
        tile_labels.push_back(fmt::format("layer {}  z {:.2f} mm", index.count(), planned.z_mm));
      }
      if (auto watched = watch.add(std::move(work.runs), nullptr, &work.light); !watched)
        return tl::unexpected{watched.error()};
      features.add(index.count(), work.at_features);
    }
    report(progress, WorkStage::MakingMasks, static_cast<double>(first + count) / print_layers);
  }
  summary.check = watch.finish();
  summary.thin = features.finish();
  summary.preview = contact_sheet(tile_images, tile_labels, kPreviewColumns, kTilePx);
  if (auto ok = plan.validate(); !ok) return tl::unexpected{ok.error()};
  summary.support_seconds = std::chrono::duration<double>(supported - begun).count();
  summary.mask_seconds = std::chrono::duration<double>(clock.now() - supported).count();
  return summary;
}

}  // namespace telefab::fab
