#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
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
constexpr std::uint32_t kLeastIslandPx = 4;
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
    case MaskMethod::Blend:
      return "blend";
    case MaskMethod::BlendStack:
      return "blend-stack";
  }
  return "cover";
}

Result<MaskMethod> mask_method_from_name(std::string_view name) {
  for (const MaskMethod method : {MaskMethod::Cover, MaskMethod::Blend, MaskMethod::BlendStack})
    if (name == name_of(method)) return method;
  return fail(ErrorCode::InvalidInput,
              fmt::format("{} is no way to make masks; there are: cover, blend, blend-stack", name));
}

Result<void> PlanOptions::validate() const {
  if (threads < 0 || threads > 1024)
    return fail(ErrorCode::InvalidInput, fmt::format("{} threads; 0 (all cores) to 1024 are possible", threads));
  if (mask_iterations < 1 || mask_iterations > 1000)
    return fail(ErrorCode::InvalidInput, fmt::format("{} mask iterations; 1 to 1000 are possible", mask_iterations));
  if (mask_deadline.count() < 0) return fail(ErrorCode::InvalidInput, "a mask deadline cannot be negative");
  if (!(support_grey > 0 && support_grey <= 1))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a support grey of {}; above 0 and up to 1 is possible", support_grey));
  if (!(cure_depth_layers >= 0 && cure_depth_layers <= 20))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a cure depth of {} layers; up to 20 are possible", cure_depth_layers));
  if (auto ok = pattern.validate(); !ok) return ok;
  if (pattern.kind != InnerPattern::Kind::Solid && masks != MaskMethod::BlendStack)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the pattern {} needs masks by blend-stack, which reckon with the light of later layers; "
                            "they are by {}",
                            name_of(pattern.kind), name_of(masks)));
  return supports.validate();
}

void MaskFigures::add(const MaskFigures& other) {
  length_px += other.length_px;
  squares_px3 += other.squares_px3;
  tiles += other.tiles;
  unsolved += other.unsolved;
}

double MaskFigures::residual_px() const { return length_px > 0 ? std::sqrt(squares_px3 / length_px) : 0; }

Result<MachineProfile> exposed_to_depth(MachineProfile machine, double cure_depth_layers) {
  if (cure_depth_layers == 0) return machine;
  auto& layers = machine.layers;
  const double irradiance = machine.projection.irradiance_mw_per_cm2, critical = machine.resin.critical_dose_mj_per_cm2;
  if (!(irradiance > 0 && critical > 0 && machine.resin.penetration_mm > 0 && layers.exposure_s > 0))
    return fail(ErrorCode::InvalidInput,
                fmt::format("machine {} has no figures for resin and light; a cure depth needs "
                            "resin.critical_dose_mj_per_cm2, resin.penetration_mm and projection.irradiance_mw_per_cm2",
                            machine.name));
  const double dose = critical * std::exp(cure_depth_layers * layers.thickness_mm / machine.resin.penetration_mm);
  layers.bottom_exposure_s *= dose / irradiance / layers.exposure_s;
  layers.exposure_s = dose / irradiance;
  return machine;
}

double layer_seconds(const MachineProfile::Motion& motion, std::chrono::microseconds exposure) {
  return std::chrono::duration<double>(exposure).count() + motion.lift_mm / motion.lift_speed_mm_per_s +
         motion.lift_mm / motion.lower_speed_mm_per_s + motion.settle_s;
}

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
  summary.lift_layers = supports->lift_layers();
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

  const LayerSource source{stack, *supports};
  const auto maker = make_mask_maker(source, machine, options, clock);
  if (!maker) return tl::unexpected{maker.error()};
  MaskWatch watch{frame.pixel_pitch_mm, kLeastIslandPx};
  auto model = cure_model(machine);
  FeatureWatch features{stack.layers(), summary.lift_layers, frame.pixel_pitch_mm,
                        model ? std::optional{std::move(*model)} : std::nullopt};
  const auto finish = [&](MaskMaker::Made made, const std::function<void(Mask&)>& cured) {
    LayerWork work;
    const Mask& mask = made.mask;
    auto png = encode_png_grey(frame.size.width_px, frame.size.height_px, mask.rows);
    if (!png) {
      work.outcome = tl::unexpected{png.error()};
      return work;
    }
    work.png = std::move(*png);
    work.supports = std::move(made.section);
    work.digest = digest_of(bytes_of(mask));
    work.grey_sum = sums_of(mask.rows).grey;
    if (std::binary_search(tile_layers.begin(), tile_layers.end(), made.index)) work.tile = cropped(mask, crop);
    const auto exposure = exposure_of(machine, made.index);
    work.at_features = features.light_of(made.index, {mask.view(), exposure});
    work.light.lit =
        LayerRuns::from_mask(mask.view(), gel_level(machine, std::chrono::duration<double>(exposure).count()));
    cured(made.mask);
    work.runs = LayerRuns::from_mask(made.mask.view(), kCuredPixel);
    work.light.joined = LayerRuns::from_mask(made.mask.view(), kJoinedPixel);
    work.solid_pixels = sums_of(made.mask.rows).white;
    return work;
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
    report(progress, "making masks", static_cast<double>(first + count) / print_layers);
  }
  summary.check = watch.finish();
  summary.thin = features.finish();
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
                           {"anchors_under_floating", s.figures.floating},
                           {"repairs", s.repairs},
                           {"to_support_mm2", s.figures.to_support_mm2},
                           {"part_mm3", s.figures.part_mm3},
                           {"support_mm3", s.figures.support_mm3},
                           {"cured_mm3", s.cured_mm3},
                           {"exposure_s", s.exposure_s},
                           {"print_s", s.print_s},
                           {"white_dose_mj_per_cm2", s.white_dose_mj_per_cm2},
                           {"cure_depth_mm", s.cure_depth_mm},
                           {"masks",
                            {{"method", name_of(s.masks)},
                             {"pattern", name_of(s.pattern.kind)},
                             {"iterations", s.mask_iterations},
                             {"contour_px", s.mask_figures.length_px},
                             {"residual_rms_px", s.mask_figures.residual_px()},
                             {"tiles_solved", s.mask_figures.tiles},
                             {"tiles_left_as_cover", s.mask_figures.unsolved},
                             {"deadline_reached", s.mask_figures.unsolved > 0}}},
                           {"thin", ordered_json::parse(to_json(s.thin))},
                           {"plan_digest", to_hex(plan_digest(s.plan))},
                           {"check", ordered_json::parse(to_json(s.check))},
                           {"seconds", {{"supports", s.support_seconds}, {"masks", s.mask_seconds}}}};
  return value.dump(1) + "\n";
}

}  // namespace telefab::fab
