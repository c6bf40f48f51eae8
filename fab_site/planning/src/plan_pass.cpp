// SPDX-License-Identifier: GPL-3.0-or-later
#include "plan_pass.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/fab/print/print_time.hpp>
#include <telefab/machine/exposure_time.hpp>
#include <telefab/machine/profile_digest.hpp>

#include "contact_sheet.hpp"
#include "kept_pass.hpp"
#include "layer_work.hpp"
#include "mask_budget.hpp"
#include "mask_maker.hpp"
#include "ready_maker.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint32_t kBlocksPerRound = 2;  // for every thread

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

std::optional<CureModel> model_of(const MachineProfile& machine) {
  auto model = cure_model(machine);
  return model ? std::optional{std::move(*model)} : std::nullopt;
}

CarryOptions carry_options(const MachineProfile& machine) {
  constexpr double kLittleMm2 = 10, kFewTips = 80;  // as much, where tips have a radius of 0.2 mm
  const double tip_mm = machine.supports.tip_radius_mm;
  return {.pitch_mm = machine.projection.pixel_pitch_mm,
          .thickness_mm = machine.layers.thickness_mm,
          .sideways_share = machine.motion.push_kpa / machine.pull_of_film_kpa(),
          .weight_share = machine.weight_share(),
          .vacuum_share = machine.vacuum_of_hollow_kpa() / machine.pull_of_film_kpa(),
          .doubled_at_mm = machine.motion.pull_size_mm,
          .limit = machine.carried_demand(),
          .least_held_mm2 = std::min(kLittleMm2, kFewTips * std::numbers::pi * tip_mm * tip_mm)};
}

/// A speck that no pin's tip is as small as would cure on nothing: it gets no light of its own.
std::uint64_t most_speck_pixels(const MachineProfile& machine, const PlanOptions& options) {
  if (options.supports.mode == SupportOptions::Mode::None) return 0;
  const double tip_px = machine.supports.tip_radius_mm / machine.projection.pixel_pitch_mm;
  return static_cast<std::uint64_t>(std::numbers::pi * tip_px * tip_px);
}

/// Times and motion of layers: as the machine has them, or as another program made them.
class LayerTimes {
 public:
  /// As MaskRounds has them.
  LayerTimes(const MachineProfile& machine, const MachineProfile& shown, const ReadyPrint* ready)
      : machine_{machine}, shown_{shown}, ready_{ready} {}

  [[nodiscard]] std::chrono::microseconds at_full_light(std::uint32_t index) const {
    if (!ready_) return exposure_of(machine_, index);
    const ReadyPrint::Layer& layer = ready_->layers[index];
    return std::chrono::microseconds{std::llround(static_cast<double>(layer.exposure.count()) * layer.light_share)};
  }
  /// The grey from which the layer's own exposure begins to cure.
  [[nodiscard]] std::uint8_t lit_from(std::uint32_t index) const {
    if (ready_) return kReadySolid;
    return gel_level(machine_, std::chrono::duration<double>{at_full_light(index)}.count());
  }
  /// Of a layer that lights so much; a dark one is passed without light.
  void set(PlannedLayer& planned, bool is_dark, double lit_mm2, double thickness_mm) const {
    const std::uint32_t index = planned.index.count();
    if (ready_) {
      const ReadyPrint::Layer& layer = ready_->layers[index];
      planned.z_mm = layer.z_mm;
      planned.exposure = timed(layer.exposure);
      planned.light_share = layer.light_share;
      planned.motion = layer.motion;
    } else {
      planned.z_mm = (index + 1) * thickness_mm;
      planned.exposure = exposure_of(shown_, index);
      planned.light_share = shown_.light_share_of_layer(index);
      planned.motion = motion_of(shown_.motion, index < shown_.layers.bottom_count, lit_mm2);
    }
    if (is_dark) planned.exposure = std::chrono::microseconds{0};
  }

 private:
  /// To what the light of this machine can be timed; none stays none.
  [[nodiscard]] std::chrono::microseconds timed(std::chrono::microseconds exposure) const {
    if (exposure.count() == 0) return exposure;
    const double seconds = timed_exposure_s(shown_, std::chrono::duration<double>{exposure}.count());
    return std::chrono::microseconds{std::llround(seconds * 1e6)};
  }

  const MachineProfile& machine_;
  const MachineProfile& shown_;
  const ReadyPrint* ready_;
};

/// The masks of a print, round by round: made in parallel, decided upon in order, encoded in parallel, handed on in
/// order. What is under way lies here.
class MaskRounds {
 public:
  /// `machine` at full light, by which doses are computed; `shown`: as its light is ordered. `earlier`: the pass whose
  /// masks stay where nothing changed, if any; `kept` gets those of this one, whose supports it has.
  MaskRounds(const LayerStack& stack, const KeptPass* earlier, KeptPass& kept, const MachineProfile& machine,
             const MachineProfile& shown, const PlanOptions& options, const PlanSink& sink, PlanSummary& summary)
      : stack_{stack},
        earlier_{earlier},
        kept_{kept},
        machine_{machine},
        times_{machine, shown, options.ready.get()},
        shown_{shown},
        sink_{sink},
        summary_{summary},
        print_layers_{summary.part_layers + summary.elevation_layers},
        source_{stack, kept.supports()},
        sheet_{stack, kept.supports(), print_layers_, mask_frame(machine)},
        watch_{machine.projection.pixel_pitch_mm, kLeastIslandPixels},
        carry_{carry_options(machine)},
        features_{stack.layers(), summary.elevation_layers, machine.projection.pixel_pitch_mm, model_of(machine)},
        most_speck_px_{most_speck_pixels(machine, options)},
        at_once_{static_cast<int>(
            masks_at_once(mask_frame(machine).size,
                          static_cast<std::uint32_t>(options.threads == 0 ? tbb::this_task_arena::max_concurrency()
                                                                          : options.threads)))},
        arena_{at_once_} {}

  [[nodiscard]] Result<void> run(const PlanOptions& options, const Clock& clock, const ProgressSink& progress,
                                 const std::stop_token& stop) {
    auto maker = options.ready ? ready_mask_maker(*options.ready, mask_frame(machine_).size)
                               : make_mask_maker(source_, machine_, options, clock);
    if (!maker) return tl::unexpected{maker.error()};
    const std::uint32_t in_round = (*maker)->block_layers() * kBlocksPerRound * static_cast<std::uint32_t>(at_once_);
    for (std::uint32_t first = 0; first < print_layers_; first += in_round) {
      if (stop.stop_requested()) return cancelled("planning");
      const std::uint32_t count = std::min(in_round, print_layers_ - first);
      if (auto ok = make(**maker, first, count, stop); !ok) return ok;
      if (auto ok = decide(); !ok) return ok;
      if (auto ok = encode_all(); !ok) return ok;
      for (LayerWork& work : round_)
        if (auto ok = hand_on(work); !ok) return ok;
      report(progress, WorkStage::MakingMasks, static_cast<double>(first + count) / print_layers_);
    }
    summary_.check = watch_.finish();
    const Nanoseconds made = clock.now();
    auto carry = arena_.execute([&] { return carry_.finish(stop); });
    if (!carry) return tl::unexpected{carry.error()};
    summary_.carry = std::move(*carry);
    summary_.carry_seconds = std::chrono::duration<double>(clock.now() - made).count();
    summary_.thin = features_.finish();
    summary_.preview = sheet_.draw(caption());
    if (auto ok = summary_.plan.validate(); !ok) return ok;
    summary_.print_s = std::chrono::duration<double>(print_time(summary_.plan, {}, stage_pace(shown_), {})).count();
    return {};
  }

 private:
  using Layers = MaskMaker::Layers;

  Result<void> make(MaskMaker& maker, std::uint32_t first, std::uint32_t count, const std::stop_token& stop) {
    round_.clear();
    round_.resize(count);
    std::vector<Layers> standing, missing;
    for (std::uint32_t from = first; from < first + count; from += maker.block_layers()) {
      const Layers block{from, std::min(from + maker.block_layers(), first + count)};
      const bool stands = earlier_ && earlier_->stands(block, maker.looked_at(block), kept_.supports());
      (stands ? standing : missing).push_back(block);
    }
    std::vector<Result<BlendFigures>> reached(missing.size());
    const auto make_block = [&](std::size_t b) {
      const auto take = [&](MaskMaker::Made made, const std::function<void(Mask&)>& cured) -> Result<void> {
        const std::uint32_t index = made.index;
        round_[index - first] = made_layer(std::move(made), cured, times_.lit_from(index));
        return {};
      };
      reached[b] = maker.make(missing[b], take, stop);
    };
    const auto recall = [&](std::uint32_t i) {
      round_[i - first] = kept_layer(earlier_->layer(i), i, source_.section(i), times_.lit_from(i));
    };
    const auto read = arena_.execute([&]() -> Result<void> {
      features_.look(first + count);
      if (auto ok = maker.read(missing, stop); !ok) return ok;
      tbb::parallel_for(std::size_t{0}, missing.size(), make_block, tbb::simple_partitioner{});
      for (const Layers& block : standing) tbb::parallel_for(block.first, block.behind, recall);
      return {};
    });
    if (!read) return read;
    for (const auto& block : reached)
      if (!block) return tl::unexpected{block.error()};
    add_figures(first, count, maker.block_layers(), missing, reached);
    return {};
  }

  /// Of all blocks of a round, in their order; what was made is kept.
  void add_figures(std::uint32_t first, std::uint32_t count, std::uint32_t in_block, std::span<const Layers> missing,
                   std::span<const Result<BlendFigures>> reached) {
    std::size_t next = 0;
    for (std::uint32_t from = first; from < first + count; from += in_block) {
      const Layers block{from, std::min(from + in_block, first + count)};
      const bool is_made = next < missing.size() && missing[next].first == from;
      const BlendFigures figures = is_made ? *reached[next++] : earlier_->figures(from);
      summary_.mask_figures.add(figures);
      std::vector<std::shared_ptr<const KeptLayer>> layers;
      for (std::uint32_t i = block.first; i < block.behind; ++i) layers.push_back(std::move(round_[i - first].made));
      kept_.keep(block, std::move(layers), figures);
    }
  }

  /// What floats is known in order alone, from below.
  Result<void> decide() {
    for (LayerWork& work : round_) {
      const LayerRuns specks = watch_.specks(work.runs, &work.light, most_speck_px_);
      summary_.specks += darken_specks(work, specks, times_.lit_from(work.index));
      const double pitch_mm = machine_.projection.pixel_pitch_mm;
      const double solid_mm2 = static_cast<double>(work.solid_pixels) * pitch_mm * pitch_mm;
      const double pull_share = machine_.pull_share_of_layer(work.index, solid_mm2);
      if (auto ok = carry_.add(work.runs, work.firm, &work.light, pull_share); !ok) return ok;
      if (auto ok = watch_.add(std::move(work.runs), nullptr, &work.light); !ok) return ok;
    }
    return {};
  }

  Result<void> encode_all() {
    arena_.execute([&] {
      tbb::parallel_for(std::size_t{0}, round_.size(), [&](std::size_t i) {
        LayerWork& work = round_[i];
        work.outcome = encode(work, times_.at_full_light(work.index), features_, sheet_);
      });
    });
    for (const LayerWork& work : round_)
      if (!work.outcome) return work.outcome;
    return {};
  }

  Result<void> hand_on(LayerWork& work) {
    const LayerIndex index{work.index};
    if (auto ok = sink_({index, work.png, work.supports}); !ok) return ok;
    const double pitch_mm = machine_.projection.pixel_pitch_mm, thickness_mm = stack_.header().layer_thickness_mm;
    PlannedLayer planned;
    planned.index = index;
    planned.mask = work.digest;
    // What is solid in the end may have been lit by later layers alone; the pull is judged by the larger area.
    const double lit_mm2 = std::max(static_cast<double>(work.grey_sum) / 255, static_cast<double>(work.solid_pixels)) *
                           pitch_mm * pitch_mm;
    times_.set(planned, work.grey_sum == 0, lit_mm2, thickness_mm);
    if (work.grey_sum > 0 && planned.exposure.count() == 0)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer {} has pixels to light and an exposure of 0 s; correct it", work.index));
    if (lit_mm2 > summary_.peel.most_mm2) summary_.peel = {lit_mm2, index};
    summary_.cured_mm3 += static_cast<double>(work.solid_pixels) * (pitch_mm * pitch_mm * thickness_mm);
    summary_.exposure_s += std::chrono::duration<double>(planned.exposure).count();
    if (!work.tile.pixels.empty()) sheet_.add(std::move(work.tile), work.index, planned.z_mm);
    features_.add(work.index, work.at_features);
    summary_.plan.layers.push_back(planned);
    return {};
  }

  [[nodiscard]] PictureCaption caption() const {
    const Bounds2 box = bounds_of(stack_.layers());
    const double thickness_mm = stack_.header().layer_thickness_mm;
    PictureCaption caption{
        stack_.header().scan_name,
        shown_.name,
        {box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm, thickness_mm * summary_.part_layers},
        {},
        {},
        0,
        {}};
    caption.detail =
        fmt::format("masks of {} layers of {:g} mm, {} of them below the part; z of the upper face of each",
                    print_layers_, thickness_mm, summary_.elevation_layers);
    return caption;
  }
  const LayerStack& stack_;
  const KeptPass* earlier_;
  KeptPass& kept_;
  const MachineProfile& machine_;
  LayerTimes times_;
  const MachineProfile& shown_;
  const PlanSink& sink_;
  PlanSummary& summary_;
  std::uint32_t print_layers_;
  LayerSource source_;
  ContactSheet sheet_;
  MaskWatch watch_;
  CarryWatch carry_;
  FeatureWatch features_;
  std::uint64_t most_speck_px_;
  int at_once_;
  tbb::task_arena arena_;
  std::vector<LayerWork> round_;
};

/// What is known of a plan before its first mask.
PlanSummary summary_of(const LayerStack& stack, const SupportPlan& supports, const MachineProfile& machine,
                       const PlanOptions& options) {
  PlanSummary summary;
  summary.part_layers = stack.header().layer_count;
  summary.elevation_layers = supports.elevation_layers();
  summary.figures = supports.figures();
  summary.anchors.assign(supports.anchors().begin(), supports.anchors().end());
  summary.supports_json = to_json(supports);
  summary.registration_rms_mm = options.registration_rms_mm;
  summary.price = options.price;
  summary.contour_limits = options.contour_limits;
  if (options.ready) summary.origin = options.ready->origin;
  summary.masks = options.masks;
  summary.mask_iterations = options.masks == MaskMethod::Cover ? 0 : options.mask_iterations;
  summary.pattern = options.pattern;
  summary.white_dose_mj_per_cm2 = machine.projection.irradiance_mw_per_cm2 * machine.layers.exposure_s;
  summary.cure_depth_mm =
      machine.resin.penetration_mm * std::log(summary.white_dose_mj_per_cm2 / machine.resin.critical_dose_mj_per_cm2);
  summary.calibration = calibration_band(machine, summary.white_dose_mj_per_cm2);
  PrintPlan& plan = summary.plan;
  plan.job = options.job;
  plan.machine = machine.name;
  plan.masks = options.masks;
  plan.mask_size = mask_frame(machine).size;
  plan.acceleration_mm_per_s2 = machine.motion.acceleration_mm_per_s2;
  plan.z_travel_mm = machine.platform.z_travel_mm;
  return summary;
}

/// What of a profile a ready print says itself.
void take_over(const ReadyPrint& ready, MachineProfile& machine) {
  machine.layers.thickness_mm = ready.thickness_mm;
  const auto is_lit = [](const ReadyPrint::Layer& layer) { return layer.exposure.count() > 0; };
  const auto middle = ready.layers.begin() + static_cast<std::ptrdiff_t>(ready.layers.size() / 2);
  auto lit = std::find_if(middle, ready.layers.end(), is_lit);
  if (lit == ready.layers.end()) lit = std::find_if(ready.layers.begin(), middle, is_lit);
  if (lit != ready.layers.end())
    machine.layers.exposure_s = std::chrono::duration<double>{lit->exposure}.count() * lit->light_share;
}

SupportPlan without_supports(const LayerStack& stack) {
  SupportFigures figures;
  for (const Layer& layer : stack.layers())
    for (const Contour& ring : layer.contours)
      figures.part_mm3 += ring.signed_area_mm2() * stack.header().layer_thickness_mm;
  const double thickness_mm = stack.header().layer_thickness_mm;
  return {0,
          {},
          StructureSections{Structure{}, thickness_mm, stack.header().layer_count, Millimetres{thickness_mm}},
          figures};
}

/// A pass that came to the supports of an earlier one: its masks are the same, and what was found of them.
PlanSummary with_supports_of(const PlanSummary& earlier, PlanSummary now) {
  PlanSummary summary = earlier;
  summary.figures = now.figures;
  summary.anchors = std::move(now.anchors);
  summary.supports_json = std::move(now.supports_json);
  summary.support_seconds = now.support_seconds;
  summary.mask_seconds = summary.carry_seconds = 0;
  return summary;
}

}  // namespace

struct PlanPasses::State {
  /// What all passes share, found by the first.
  Result<void> begin() {
    if (exposed) return {};
    auto deeper = exposed_to_depth(profile, options.cure_depth_layers);
    if (!deeper) return tl::unexpected{deeper.error()};
    machine = deeper->at_full_light();
    if (options.ready) take_over(*options.ready, machine);
    if (auto ok = fits(stack, machine, stack.header().layer_count); !ok) return ok;
    exposed = std::move(*deeper);
    return {};
  }
  [[nodiscard]] bool may_repeat() const {
    return !options.ready && options.supports.mode != SupportOptions::Mode::None;
  }
  Result<SupportPlan> plan_supports(const SupportOptions& supports) {
    if (options.ready) return without_supports(stack);
    if (!planner) {
      SupportOptions first = supports;
      first.threads = options.threads;
      auto made = options.regions
                      ? SupportPlanner::make(options.regions, stack.header(), machine, first)
                      : SupportPlanner::make(stack.layers(), stack.header(), machine, first, progress, stop);
      if (!made) return tl::unexpected{made.error()};
      planner = std::move(*made);
    }
    return planner->plan(supports.floating, supports.bearing, progress, stop);
  }

  const LayerStack& stack;
  const MachineProfile& profile;
  PlanOptions options;
  const PlanSink& sink;
  const Clock& clock;
  const ProgressSink& progress;
  std::stop_token stop;
  std::optional<MachineProfile> exposed;  ///< to the depth that the options ask for
  MachineProfile machine;                 ///< the same at full light
  std::optional<SupportPlanner> planner;
  std::shared_ptr<KeptPass> last;  ///< the pass that the sink has
  std::shared_ptr<KeptPass> best;  ///< the one that later ones repair
};

PlanPasses::PlanPasses(const LayerStack& stack, const MachineProfile& machine, const PlanOptions& options,
                       const PlanSink& sink, const Clock& clock, const ProgressSink& progress, std::stop_token stop)
    : state_{new State{stack, machine, options, sink, clock, progress, std::move(stop), {}, {}, {}, {}, {}}} {}
PlanPasses::~PlanPasses() = default;

Result<PlanSummary> PlanPasses::plan(const SupportOptions& support_options) {
  State& s = *state_;
  if (auto ok = s.begin(); !ok) return tl::unexpected{ok.error()};
  const Nanoseconds begun = s.clock.now();
  auto supports = s.plan_supports(support_options);
  if (!supports) return tl::unexpected{supports.error()};
  const Nanoseconds supported = s.clock.now();

  PlanSummary summary = summary_of(s.stack, *supports, s.machine, s.options);
  summary.plan.profile = digest_of_light(s.profile);  // as it stands on disk, not as exposed deeper for this plan
  summary.support_seconds = std::chrono::duration<double>(supported - begun).count();
  const std::uint32_t print_layers = summary.part_layers + summary.elevation_layers;
  if (auto ok = fits(s.stack, s.machine, print_layers); !ok) return tl::unexpected{ok.error()};
  if (s.last && s.last->is_same(*supports)) return with_supports_of(*s.last->summary, std::move(summary));
  s.last = std::make_shared<KeptPass>(std::move(*supports), print_layers, s.may_repeat());
  MaskRounds rounds{s.stack, s.best.get(), *s.last, s.machine, *s.exposed, s.options, s.sink, summary};
  if (auto ok = rounds.run(s.options, s.clock, s.progress, s.stop); !ok) return tl::unexpected{ok.error()};
  summary.mask_seconds = std::chrono::duration<double>(s.clock.now() - supported).count();
  s.last->summary = summary;
  return summary;
}

void PlanPasses::repair_last() { state_->best = state_->last; }

}  // namespace telefab::fab
