// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/cure/prediction.hpp>
#include <telefab/fab/planning/drawn_contours.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/verify/print_files.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxTextBytes = 4ULL << 30U;

struct PredictVerb {
  std::string folder, contours, out;
  MachineChoice machine;
  std::string frame = "part";
  std::optional<std::string> report, preview;
  std::optional<std::uint32_t> layer;
  int sub_pixels = 4;
  int spacing_px = 1;
  int threads = 0;
  bool supports = false;
  bool json = false;
};

Result<std::uint32_t> elevation_of(const fs::path& path) {
  const auto bytes = read_file(path, kMaxTextBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  const auto supports = WrittenSupports::from_json({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
  if (!supports) return fail_in(path.string(), supports.error());
  return supports->elevation_layers();
}

/// From the option, or those that the planner kept; nothing where it kept none.
Result<std::optional<LayerStack>> contours_of(const PlannedJob& job, const PredictVerb& o) {
  auto stack = o.contours.empty() ? job.part() : read_stack(o.contours);
  if (stack) return std::optional<LayerStack>{std::move(*stack)};
  if (o.contours.empty() && stack.error().code == ErrorCode::NotFound) return std::optional<LayerStack>{};
  return tl::unexpected{stack.error()};
}

void print_band(const PredictionBand& band) {
  write_output(fmt::format(
      "the calibration knows the dose to {:.1f} % (95 %): edges may lie {:.3f} px, undersides {:.3f} mm either way\n",
      100 * band.calibration.dose_share, band.edges_px, band.undersides_mm));
}

void print_figures(const Prediction& p, const CureModel& model, bool compared) {
  write_output(fmt::format("cured {:.1f} mm3, {} surface points{}\n", p.solid.volume_mm3, p.points.size(),
                           p.support_points ? fmt::format(", {} of supports", p.support_points) : ""));
  if (!compared) {
    write_output("no contours to compare with: name them with --contours\n");
    return;
  }
  const double pitch_um = model.pixel_pitch_mm * 1000;
  write_output(fmt::format("contours enclose {:.1f} mm3: {:+.2f} %\n", p.contour_mm3,
                           p.contour_mm3 > 0 ? 100 * (p.solid.volume_mm3 / p.contour_mm3 - 1) : 0.0));
  const EdgeFigures& e = p.edges;
  write_output(
      fmt::format("edges at mid-layer: mean {:.3f} px ({:.1f} um), bias {:+.3f}, 95 % within {:.3f}, most {:.2f} px\n",
                  e.edges.mean_px(), e.edges.mean_px() * pitch_um, e.edges.bias_px(), e.edges.percentile_px(0.95),
                  e.edges.max_px()));
  write_output(
      fmt::format("  away from corners {:.3f} px; lost {:.2f} %; one per cent of dose moves them by {:.4f} px\n",
                  e.smooth.mean_px(), 100 * e.lost_share(), e.latitude_px()));
  write_output(fmt::format("  cured or missing farther than 1 px from every contour: {:.1f} px2\n", e.far_px2));
  if (p.undersides.count() > 0)
    write_output(fmt::format("undersides: {:+.2f} layers ({:+.3f} mm), mean size {:.2f}, most {:.1f}\n",
                             p.undersides.bias_px(), p.undersides.bias_px() * model.layer_mm, p.undersides.mean_px(),
                             p.undersides.max_px()));
}

/// The points move into the frame that was asked for.
Result<void> write_files(Prediction& prediction, const CureModel& model, const std::optional<PredictionBand>& band,
                         std::uint32_t elevation_layers, const PredictVerb& o) {
  if (o.frame == "part") {
    const auto elevation_mm = static_cast<float>(elevation_layers * model.layer_mm);
    for (SurfacePoint& point : prediction.points) point.z_mm -= elevation_mm;
  }
  const auto comment = fmt::format("predicted by telefab-fab, millimetres, {} frame", o.frame);
  if (!o.out.empty())
    if (auto ok = write_file_atomically(o.out, to_ply(prediction.points, comment)); !ok) return ok;
  if (o.report)
    if (auto ok = write_file_atomically(*o.report, to_json(prediction, model, band)); !ok) return ok;
  if (!o.preview) return {};
  const auto png = encode_png(prediction.picture);
  if (!png) return tl::unexpected{png.error()};
  return write_file_atomically(*o.preview, *png);
}

Result<ExitCode> predict(const PredictVerb& o, std::stop_token stop) {
  if (o.out.empty() && !o.report && !o.preview && !o.json)
    return fail(ErrorCode::InvalidInput, "nothing asked for: give --out, --report, --preview or --json");
  auto job = PlannedJob::open(o.folder);
  if (!job) return tl::unexpected{job.error()};
  const PrintPlan& plan = (*job)->plan();
  const auto machine = chosen_machine(o.machine, plan.machine);
  if (!machine) return tl::unexpected{machine.error()};
  auto model = cure_model(*machine);
  if (!model) return tl::unexpected{model.error()};
  model->mask = plan.mask_size;
  const auto stack = contours_of(**job, o);
  if (!stack) return tl::unexpected{stack.error()};
  const auto supports = (*job)->supports();
  if (!supports) return tl::unexpected{supports.error()};
  const auto elevation = elevation_of(fs::path{o.folder} / "supports.json");
  if (!elevation) return tl::unexpected{elevation.error()};

  PrintToPredict print;
  print.layers = static_cast<std::uint32_t>(plan.layers.size());
  print.elevation_layers = *elevation;
  std::optional<LayerStack> drawn;  // as the masks were made of it
  if (*stack) {
    auto grown = with_grown_holes(**stack, Millimetres{machine->resin.hole_growth_mm});
    if (!grown) return tl::unexpected{grown.error()};
    drawn = std::move(*grown);
    print.part = drawn->layers();
  }
  print.supports = *supports;
  print.light = [&](LayerIndex index) -> Result<LitLayer> {
    LitLayer light;
    const auto exposure = plan.layers[index.count()].exposure_at_full_light();
    if (exposure.count() == 0) return light;
    auto mask = (*job)->mask(index);
    if (!mask) return tl::unexpected{mask.error()};
    light.masks.push_back(std::move(*mask));
    light.lit.push_back(exposure);
    return light;
  };
  PredictOptions options;
  options.sub_pixels = o.sub_pixels;
  options.spacing_px = o.spacing_px;
  options.supports = o.supports;
  options.threads = o.threads;
  if (o.layer) options.picture = LayerIndex{*o.layer};
  options.caption.part = *stack ? (*stack)->header().scan_name : fs::path{o.folder}.filename().string();
  options.caption.machine = machine->name;
  if (*stack) options.caption.size_mm = part_size_mm(**stack);
  options.caption.detail = fmt::format("prediction by the dose model, {} layers of {:g} mm, {:.0f} µm a pixel",
                                       plan.layers.size(), model->layer_mm, 1000 * model->pixel_pitch_mm);
  auto prediction = predict_print(*model, print, options, progress_line(), stop);
  clear_progress();
  if (!prediction) return tl::unexpected{prediction.error()};
  const double exposure_s = std::chrono::duration<double>(plan.layers.back().exposure_at_full_light()).count();
  std::optional<PredictionBand> band;
  if (const auto calibration = calibration_band(*machine, machine->projection.irradiance_mw_per_cm2 * exposure_s))
    band = band_of(*prediction, *calibration);
  if (auto ok = write_files(*prediction, *model, band, *elevation, o); !ok) return tl::unexpected{ok.error()};
  if (o.json) {
    write_output(to_json(*prediction, *model, band));
  } else {
    print_figures(*prediction, *model, stack->has_value());
    if (band) print_band(*band);
  }
  const double leaked = model->leaked_dose(plan.layers.back().exposure_at_full_light());
  if (leaked >= 0.5)
    write_note(fmt::format(
        "telefab-fab: black pixels leak {:.2f} of the critical dose in a tall print; all resin sets at 1\n", leaked));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_predict(VerbOptions& options) {
  auto o = std::make_shared<PredictVerb>();
  options.add("DIR", o->folder, "a plan folder, as `telefab-fab plan` writes it").required();
  options.add_output("--out", o->out, "write the cured part's surface points with normals here (PLY)");
  options.add_output("--report", o->report, "write edge errors, by layer and overall, here (JSON)");
  options.add_output("--preview", o->preview, "write a picture here (PNG)");
  options.add_output("--contours", o->contours,
                     "the .tfc file it was planned of; default: the one in the folder, where there is one");
  declare_machine_choice(options, o->machine, "profile whose optics and resin are taken; default: the plan's",
                         MachineIs::Optional);
  options.add("--frame", o->frame, "part: z from the part's first layer; print: z from the platform")
      .one_of({"part", "print"})
      .shows_default();
  options.flag("--supports", o->supports, "write the supports' points as well");
  options.add("--layer", o->layer, "print layer whose edges the picture shows; default: the one of most contour");
  options.add("--sub-pixels", o->sub_pixels, "samples of the solid a pixel and axis").within(1, 16).shows_default();
  options.add("--spacing-px", o->spacing_px, "distance of surface points, pixels").within(1, 64).shows_default();
  options.add("--threads", o->threads, "0: all cores; the prediction is the same for any number")
      .within(0, 1024)
      .shows_default();
  options.flag("--json", o->json, "print the report as JSON");
  return [o](std::stop_token stop) { return predict(*o, stop); };
}

}  // namespace telefab::fab
