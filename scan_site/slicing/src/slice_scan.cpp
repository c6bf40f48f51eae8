// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/slicing/placed_surface.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/scan/topology/height_topology.hpp>

#include "closed_field.hpp"
#include "completed_scan.hpp"
#include "layer_cutter.hpp"
#include "layer_tally.hpp"
#include "openness.hpp"
#include "recorded_slicing.hpp"
#include "side_check.hpp"

namespace telefab::scan {
namespace {

constexpr std::array kMethods{std::pair{TraceMethod::Auto, "auto"}, std::pair{TraceMethod::Reeb, "reeb"},
                              std::pair{TraceMethod::Grid, "grid"}};
/// Layers of one task: neighbours share what a cursor has gathered.
constexpr std::uint32_t kBlock = 8;
/// Samples this near to a plane (in widths of their kernels) must lie beside its contours.
constexpr double kBandKernels = 0.8;
/// Steeper samples than this (65 degrees) never lie near a critical point; the second search looks this widely.
constexpr double kNearLevel = 0.42;
/// Samples of a scan whose copies count.
constexpr std::size_t kLargeScan = 500'000;
/// A sample within this many kernel widths of a contour is covered by it,
constexpr double kCoverKernels = 0.75;
/// and all must be, unless the noise exceeds this many spacings: then this share may stray.
constexpr double kCleanSpacings = 0.1;
constexpr double kStrayShare = 0.02;

/// A scan whose noise asks for a kernel wider than this is uncertain: its contours must be the same with kernels
/// narrower and wider by these factors.
constexpr double kCertainSpacings = 1;
constexpr std::array kKernelFactors{0.8, 1.25};
/// A scan is sparse whose spacing is more than this part of its smallest side: 33 samples across;
constexpr double kSparseShare = 0.03;
/// its contours must be the same with these kernels.
constexpr std::array kSparseKernelFactors{0.65, 1.5};

/// A height at which contours begin, end, part or join in a gap is taken as known within this part of the error that
/// the surface there may have (which 19 of 20 do not exceed). A layer on either side is doubtful in any case.
constexpr double kCriticalErrorShare = 0.5;

/// So many layers that nothing predicts are worth a plane that is cut both ways, at one of these parts of their height.
constexpr double kCountedLayers = 12;
constexpr std::array kCountedAt{0.5, 0.25, 0.75};

/// Spacing that varies by more than this leaves room for a feature, or a whole wall, that no sample shows.
constexpr double kMostUneven = 5;

/// Contours this near to a sample of two sheets are made of them.
constexpr double kDoubledSpacings = 1.5;

/// Points farther apart than so many pixels show less than a print would.
constexpr double kThinnedPixels = 0.5;

/// Rounding this coarse (in spacings) leaves no contour to be trusted.
constexpr double kCoarseRounding = 0.3;

/// What is wrong with the scan as a whole, so that no layer of it can be vouched for.
std::optional<Doubt> doubt_of(const KernelChoice& kernel, const PreparedScan& scan, double rounding_mm) {
  if (scan.has_empty_faces) return Doubt{.reason = DoubtReason::FacesEmpty};
  if (rounding_mm > kCoarseRounding * kernel.spacing_mm)
    return Doubt{.reason = DoubtReason::CoordinatesRounded, .size_mm = rounding_mm};
  return std::nullopt;
}

std::optional<std::string> warning_of(const KernelChoice& kernel) {
  if (kernel.unevenness <= kMostUneven) return std::nullopt;
  return fmt::format(
      "the spacing of the scan varies {:.0f}-fold: what is smaller than its widest spacing may be missing between its "
      "points",
      kernel.unevenness);
}

std::optional<std::string> warning_of(std::span<const DoubledPlace> doubled, bool are_guessed) {
  if (doubled.empty()) return std::nullopt;
  double farthest = 0;
  for (const DoubledPlace& p : doubled) farthest = std::max(farthest, p.apart_mm);
  return fmt::format(
      "{} points of the scan {} on two sheets, up to {:.2g} mm apart, where one surface ought to be; "
      "register its views again: layers through them are flagged",
      doubled.size(), are_guessed ? "seem to lie" : "lie", farthest);
}

Result<HeightTopology> topology_of(const MlsField& field, std::stop_token stop) {
  TopologyOptions options;
  options.noise_mm = field.kernel().noise_mm;
  const auto from = [&](double least_nz) {
    SurfaceSamples level;
    field.level_samples(least_nz, level);
    return analyse_height(field, level, options, stop);
  };
  // Only plateaus and inconsistent places ask for the steeper samples. They are four times as many: of a large scan the
  // others are tried alone first, to save memory.
  if (field.sample_count() > kLargeScan) {
    auto found = from(options.min_start_nz);
    if (found && found->inconsistencies().empty() && found->plateaus().empty()) return found;
  }
  return from(kNearLevel);
}

/// Where the scan does not tell how contours go together: about critical points in gaps, and between pieces of
/// completed surface that may be one.
std::vector<CutSetting::UndecidedPlace> undecided_places(const CompletedScan& completed, const ScalarField& field,
                                                         const HeightTopology* topology, double layer_mm) {
  std::vector<CutSetting::UndecidedPlace> places;
  if (topology)
    for (const CriticalPoint& c : topology->critical_points())
      if (const double error = completed.error_at(c.position_mm, field); error > 0) {
        const double reach = std::max(kCriticalErrorShare * error, layer_mm);
        places.push_back({c.position_mm - reach * Vec3::UnitZ(), c.position_mm + reach * Vec3::UnitZ(), reach});
      }
  for (const CompletedScan::Passage& p : completed.passages())
    places.push_back({p.low_mm, p.high_mm, (p.high_mm - p.low_mm).norm()});
  return places;
}

/// Where the graph misses something on both sides, a plane cut both ways tells the Euler number of all heights up to
/// the next thing missed: their layers need be cut one way only.
Result<void> count_hidden_heights(const CutSetting& setting, const StackHeader& header, HeightTopology& topology,
                                  std::stop_token stop) {
  if (topology.uncounted().empty()) return {};
  CutSetting alone = setting;
  alone.topology = nullptr;
  LayerCutter cutter{alone};
  const double least_mm = kCountedLayers * header.layer_thickness_mm;
  const auto counted_in = [&](const HeightRange& range) -> Result<bool> {
    for (const double share : kCountedAt) {
      const double wanted_mm = range.low_mm + share * (range.high_mm - range.low_mm);
      const LayerIndex index{static_cast<std::uint32_t>(std::max(0.0, wanted_mm / header.layer_thickness_mm))};
      const double z_mm = cut_height_mm(index, header.layer_thickness_mm);
      if (index.count() >= header.layer_count || topology.is_near_critical(z_mm)) continue;
      const auto cut = cutter.cut(index, z_mm, stop);
      if (!cut) return tl::unexpected{cut.error()};
      if (!cut->layer.certificate.is_certified()) continue;
      topology.count(z_mm, cut->layer.certificate.measured_euler);
      return true;
    }
    return false;
  };
  std::vector<double> given_up;  // where the ranges begin
  for (bool goes_on = true; goes_on;) {
    goes_on = false;
    for (const HeightRange& range : topology.uncounted()) {
      if (range.high_mm - range.low_mm < least_mm || std::count(given_up.begin(), given_up.end(), range.low_mm) > 0)
        continue;
      const auto done = counted_in(range);
      if (!done) return tl::unexpected{done.error()};
      if (*done)
        goes_on = true;
      else
        given_up.push_back(range.low_mm);
    }
  }
  return {};
}

bool positive(const std::optional<double>& value, double most) {
  return !value || (std::isfinite(*value) && *value > 0 && *value <= most);
}

struct Block {
  std::uint32_t first = 0;
  Result<std::vector<CutLayer>> cut;
};

Result<void> cut_layers(const CutSetting& setting, const StackHeader& header, const LayerRange& range, unsigned threads,
                        CutRecorder* recorder, LayerTally& tally, const ProgressSink& progress, std::stop_token stop) {
  std::stop_source halt;
  const std::stop_callback link{stop, [&] { halt.request_stop(); }};
  Result<void> outcome;
  std::uint32_t next = range.first;
  const std::uint32_t end = range.end;
  tbb::enumerable_thread_specific<std::unique_ptr<LayerCutter>> cutters;
  const auto source = [&](tbb::flow_control& flow) -> std::uint32_t {
    if (next >= end || halt.stop_requested()) {
      flow.stop();
      return 0;
    }
    const std::uint32_t first = next;
    next = std::min(end, next + kBlock);
    return first;
  };
  const auto work = [&](std::uint32_t first) -> std::shared_ptr<Block> {
    auto& cutter = cutters.local();
    if (!cutter) cutter = std::make_unique<LayerCutter>(setting);
    auto block = std::make_shared<Block>();
    block->first = first;
    std::vector<CutLayer> cut;
    for (std::uint32_t i = first; i < std::min(end, first + kBlock); ++i) {
      const LayerIndex index{i};
      const double z_mm = cut_height_mm(index, header.layer_thickness_mm);
      auto layer = cutter->cut(index, z_mm, halt.get_token());
      if (!layer) {
        block->cut = fail_in(fmt::format("layer {}", i), layer.error());
        return block;
      }
      cut.push_back(std::move(*layer));
    }
    block->cut = std::move(cut);
    return block;
  };
  const auto deliver = [&](const std::shared_ptr<Block>& block) {
    if (!outcome) return;
    if (!block->cut) {
      outcome = tl::unexpected{block->cut.error()};
      halt.request_stop();
      return;
    }
    for (CutLayer& cut : *block->cut) {
      const std::uint32_t done = cut.layer.index.count() + 1 - range.first;
      if (recorder) recorder->layer(cut);
      if (auto ok = tally.take(std::move(cut)); !ok) {
        outcome = std::move(ok);
        halt.request_stop();
        return;
      }
      telefab::report(progress, WorkStage::CuttingContours, static_cast<double>(done) / (end - range.first));
    }
  };
  tbb::parallel_pipeline(
      4 * static_cast<std::size_t>(threads),
      tbb::make_filter<void, std::uint32_t>(tbb::filter_mode::serial_in_order, source) &
          tbb::make_filter<std::uint32_t, std::shared_ptr<Block>>(tbb::filter_mode::parallel, work) &
          tbb::make_filter<std::shared_ptr<Block>, void>(tbb::filter_mode::serial_in_order, deliver));
  if (outcome && stop.stop_requested()) return cancelled("cutting layers");
  return outcome;
}

Result<SliceReport> slice(std::span<const std::byte> scan, std::string_view name, const SliceRequest& request,
                          unsigned threads, CutRecorder* recorder, const LayerSink& sink, const ProgressSink& progress,
                          std::stop_token stop) {
  SliceReport result;
  StageClock clock{result.times};
  IntakeOptions intake = request.intake;
  intake.pick.keep_outliers |= !request.mls.drop_outliers;
  auto surface = surface_of(scan, name, intake, request, progress, clock, stop);
  if (!surface) return tl::unexpected{surface.error()};
  PreparedScan& prepared = surface->prepared;
  Placement* const placed = &surface->placed;
  std::unique_ptr<MlsField>* const field = &surface->field;
  result.points = prepared.points;
  result.pick = std::move(prepared.pick);
  result.normals_json = to_json(prepared.normals);
  result.warnings = prepared.warnings;
  result.placement = placed->options;
  result.chosen = surface->chosen;
  result.size_mm = {placed->size_mm.x(), placed->size_mm.y(), placed->size_mm.z()};
  if (placed->scale_warning) {
    if (!placed->unit_is_stated)
      return fail(ErrorCode::InvalidInput, fmt::format("{}: {}", name, *placed->scale_warning));
    result.warnings.push_back(*placed->scale_warning);
  }
  StackHeader& header = result.header;
  header.machine = request.machine.name;
  header.layer_thickness_mm = request.layer_mm.value_or(request.machine.layers.thickness_mm);
  header.pixel_pitch_mm = request.machine.projection.pixel_pitch_mm;
  header.scan_to_build = placed->scan_to_build;
  header.scan_name = std::string{name};
  // Every layer whose middle lies inside the part; a part thinner than that still gets one.
  const double count = std::max(1.0, std::ceil(placed->size_mm.z() / header.layer_thickness_mm - 0.5 - 1e-9));
  if (count > kMaxLayers)
    return fail(ErrorCode::TooLarge, fmt::format("{:.0f} layers of {} mm; at most {} are possible", count,
                                                 header.layer_thickness_mm, kMaxLayers));
  header.layer_count = static_cast<std::uint32_t>(count);
  const auto range = range_of(request, header.layer_count);
  if (!range) return tl::unexpected{range.error()};
  result.kernel = (*field)->kernel();
  result.surface = std::string{name_of(request.mls.surface)};
  clock.lap("surface");

  auto scan_closed = CompletedScan::of(**field, request, progress, stop);
  if (!scan_closed) return tl::unexpected{scan_closed.error()};
  const CompletedScan& completed = **scan_closed;
  result.open = completed.openness();
  result.completion = completed.summary();
  if (auto ok = completed.check(request); !ok) return refused(result, ok.error());
  for (std::string& warning : completed.warnings(request)) result.warnings.push_back(std::move(warning));
  if (const auto samples = completed.gap_samples(); !samples.empty()) *field = (*field)->completed_by(samples);
  clock.lap("gaps");

  const Box3 box = (*field)->bounds();
  header.bounds = {{box.min.x(), box.min.y()}, {box.max.x(), box.max.y()}};
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  // Where nothing can be vouched for, nobody need find the contours twice.
  const std::optional<Doubt> known_doubt = doubt_of(result.kernel, prepared, placed->cloud.rounding);
  const TraceMethod method = known_doubt && request.method == TraceMethod::Auto ? TraceMethod::Grid : request.method;
  std::optional<HeightTopology> topology;
  if (method != TraceMethod::Grid) {
    telefab::report(progress, WorkStage::FindingTopology, 0);
    auto found = topology_of(**field, stop);
    if (found) {
      topology = std::move(*found);
      if (topology->euler_is_certain()) result.surface_euler = topology->euler();
      result.critical_points = topology->critical_points().size();
      result.inconsistencies.assign(topology->inconsistencies().begin(), topology->inconsistencies().end());
    } else if (found.error().code == ErrorCode::Cancelled) {
      return tl::unexpected{found.error()};
    } else {
      result.inconsistencies.push_back(found.error().what);
    }
    clock.lap("topology");
  }

  const KernelChoice& kernel = result.kernel;
  const bool sparse = kernel.spacing_mm > kSparseShare * placed->size_mm.minCoeff();
  std::vector<std::unique_ptr<MlsField>> others;
  const double spacings = kernel.kernel_mm / kernel.spacing_mm;
  const bool noisy = kernel.noise_mm > kCleanSpacings * kernel.spacing_mm;
  // A width given by hand may be far from what the noise asks for: it is tried as hard as a sparse scan's.
  const bool widely = sparse || request.mls.kernel_mm;
  if (!known_doubt && (sparse || (request.mls.kernel_mm ? noisy : kernel.noise_factor > kCertainSpacings)))
    for (const double wanted : widely ? kSparseKernelFactors : kKernelFactors)
      // Narrower than 0.9 spacings a field has holes.
      if (const double factor = std::max(wanted, 0.9 / spacings); std::abs(factor - 1) > 0.05)
        others.push_back((*field)->with_scaled_kernel(factor));
  const ClosedField closed{**field, completed};
  const ClosedField last_resort{**field, completed, ClosedField::Asked::Everywhere};
  CutSetting setting{
      .field = **field,
      .closed = &closed,
      .last_resort = &last_resort,
      .topology = topology ? &*topology : nullptr,
      .samples = [&](double low, double high, SurfaceSamples& found) { (*field)->samples_between(low, high, found); },
      .band_mm = kBandKernels * (*field)->widest_kernel_mm(),
      .band_kernels = kBandKernels,
      .cover_kernels = kCoverKernels,
      .stray_share = noisy ? kStrayShare : 0,
      .noise_mm = kernel.noise_mm,
      .sparse = sparse,
      .chord_mm = request.chord_mm.value_or(request.machine.chord_tolerance_mm()),
      .method = method,
      .other_kernels = {},
      // An edge that nobody measured is completed, and said to be: it is as sharp as it was made.
      .measured = [&](const Vec3& place_mm) { return completed.is_measured(place_mm, **field); },
      .surface = [&](const Contour& contour, double z_mm) { return completed.surface_of(contour, z_mm, **field); },
      .contradiction =
          [&](std::span<const Contour> contours, double z_mm, const SurfaceSamples& near) {
            const auto narrow = narrow_passage(**field, contours, z_mm);
            return narrow ? narrow : contradicted_side(completed, **field, contours, z_mm, near);
          },
      .known_doubt = known_doubt};
  setting.doubled = surface->doubled;
  setting.doubled_reach_mm = kDoubledSpacings * kernel.spacing_mm;
  setting.undecided = undecided_places(completed, **field, topology ? &*topology : nullptr, header.layer_thickness_mm);
  if (const auto warning = warning_of(kernel)) result.warnings.push_back(*warning);
  if (prepared.is_thinned && kernel.spacing_mm > kThinnedPixels * header.pixel_pitch_mm)
    result.warnings.push_back(
        fmt::format("the points that are taken of the file lie {:.2g} mm apart, and a pixel is {:.2g} mm wide: the "
                    "file may show finer detail than is printed; take more of them (slice --samples)",
                    kernel.spacing_mm, header.pixel_pitch_mm));
  if (const auto warning = warning_of(surface->doubled, prepared.sheets_are_guessed))
    result.warnings.push_back(*warning);
  for (const auto& other : others) setting.other_kernels.push_back(other.get());
  result.specks.least_mm2 = request.speck_px2 * header.pixel_pitch_mm * header.pixel_pitch_mm;
  result.method = kMethods[static_cast<std::size_t>(request.method) - 1].second;
  if (topology && method == TraceMethod::Auto)
    if (auto ok = count_hidden_heights(setting, header, *topology, stop); !ok) return tl::unexpected{ok.error()};
  if (recorder) recorder->begin(result, *range);
  LayerTally tally{result, sink};
  if (auto ok = cut_layers(setting, header, *range, threads, recorder, tally, progress, stop); !ok)
    return tl::unexpected{ok.error()};
  clock.lap("contours");
  if (auto ok = tally.finish(); !ok) return tl::unexpected{ok.error()};
  return result;
}

}  // namespace

Result<TraceMethod> trace_method_from(std::string_view name) {
  for (const auto& [method, text] : kMethods)
    if (name == text) return method;
  return fail(ErrorCode::InvalidInput, fmt::format("no method named \"{}\"; there are auto, reeb, grid", name));
}

Result<void> base_as(std::string_view text, SliceRequest& request) {
  if (text != "flat" && text != "scanned")
    return fail(ErrorCode::InvalidInput, fmt::format("a base is flat or scanned, not \"{}\"", text));
  request.flat_base = text == "flat";
  return {};
}

Result<void> complete_gaps_as(std::string_view text, SliceRequest& request) {
  request.complete = text != "off";
  request.most_gap_mm.reset();
  if (text == "auto" || text == "off") return {};
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size())
    return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not auto, off or a number of millimetres", text));
  request.most_gap_mm = value;
  return {};
}

Result<void> SliceRequest::validate() const {
  if (auto ok = placement.validate(); !ok) return ok;
  if (placement.stand_for && flat_base)
    return fail(ErrorCode::InvalidInput,
                "a flat base is cut where the scan stands: say which way is up, it cannot be chosen");
  if (!positive(layer_mm, 1))
    return fail(ErrorCode::InvalidInput, fmt::format("layer thickness {} mm is not in (0, 1]", *layer_mm));
  if (!positive(thickness_mm, kMaxCoordinateMm))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a thickness of {} mm is not in (0, {}]", *thickness_mm, kMaxCoordinateMm));
  if (!positive(chord_mm, 1))
    return fail(ErrorCode::InvalidInput, fmt::format("chord tolerance {} mm is not in (0, 1]", *chord_mm));
  if (!positive(most_gap_mm, kMaxCoordinateMm))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a gap of {} mm is not in (0, {}]", *most_gap_mm, kMaxCoordinateMm));
  if (!(speck_px2 >= 0 && speck_px2 <= 100))
    return fail(ErrorCode::InvalidInput, fmt::format("specks of {} pixels are not in [0, 100]", speck_px2));
  if (share && !(share->index >= 1 && share->index <= share->count && share->count <= kMaxLayers))
    return fail(ErrorCode::InvalidInput, fmt::format("share {}/{} is not one of 1/1 to {}/{}", share->index,
                                                     share->count, kMaxLayers, kMaxLayers));
  if (threads > 1024) return fail(ErrorCode::InvalidInput, fmt::format("{} threads; at most 1024", threads));
  return mls.validate();
}

Result<SliceReport> slice_recorded(std::span<const std::byte> scan, std::string_view name, const SliceRequest& request,
                                   CutRecorder* recorder, const LayerSink& sink, const ProgressSink& progress,
                                   std::stop_token stop) {
  if (auto ok = request.validate(); !ok) return tl::unexpected{ok.error()};
  const unsigned threads =
      request.threads > 0 ? request.threads : static_cast<unsigned>(tbb::info::default_concurrency());
  // More threads than cores are wanted only by tests of equal bytes; the control lets them exist.
  const tbb::global_control allow{
      tbb::global_control::max_allowed_parallelism,
      std::max<std::size_t>(threads, tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism))};
  tbb::task_arena arena{static_cast<int>(threads)};
  return arena.execute([&] { return slice(scan, name, request, threads, recorder, sink, progress, stop); });
}

Result<SliceReport> slice_scan(std::span<const std::byte> scan, std::string_view name, const SliceRequest& request,
                               const LayerSink& sink, const ProgressSink& progress, std::stop_token stop) {
  return slice_recorded(scan, name, request, nullptr, sink, progress, stop);
}

}  // namespace telefab::scan
