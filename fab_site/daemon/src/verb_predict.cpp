#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>

#include "predict_plan.hpp"
#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

struct PredictVerb {
  std::string folder, contours, machine, out;
  std::string machines = default_machine_folder();
  std::string frame = "part";
  std::optional<std::string> report, preview;
  std::optional<std::uint32_t> layer;
  int sub_pixels = 4;
  int spacing_px = 1;
  int threads = 0;
  bool supports = false;
  bool json = false;
};

void tell(const Prediction& p, const CureModel& model, bool compared) {
  fmt::print("cured {:.1f} mm3, {} surface points{}\n", p.solid.volume_mm3, p.points.size(),
             p.support_points ? fmt::format(", {} of supports", p.support_points) : "");
  if (!compared) {
    fmt::print("no contours to compare with: name them with --contours\n");
    return;
  }
  const double pitch_um = model.pixel_pitch_mm * 1000;
  fmt::print("contours enclose {:.1f} mm3: {:+.2f} %\n", p.contour_mm3,
             p.contour_mm3 > 0 ? 100 * (p.solid.volume_mm3 / p.contour_mm3 - 1) : 0.0);
  const EdgeFigures& e = p.edges;
  fmt::print("edges at mid-layer: mean {:.3f} px ({:.1f} um), bias {:+.3f}, 95 % within {:.3f}, most {:.2f} px\n",
             e.edges.mean_px(), e.edges.mean_px() * pitch_um, e.edges.bias_px(), e.edges.percentile_px(0.95),
             e.edges.max_px());
  fmt::print("  away from corners {:.3f} px; lost {:.2f} %; one per cent of dose moves them by {:.4f} px\n",
             e.smooth.mean_px(), 100 * e.lost_share(), e.latitude_px());
  fmt::print("  cured or missing farther than 1 px from every contour: {:.1f} px2\n", e.far_px2);
  if (p.undersides.count() > 0)
    fmt::print("undersides: {:+.2f} layers ({:+.3f} mm), mean size {:.2f}, most {:.1f}\n", p.undersides.bias_px(),
               p.undersides.bias_px() * model.layer_mm, p.undersides.mean_px(), p.undersides.max_px());
}

Result<void> write_files(const Prediction& prediction, const CureModel& model, std::uint32_t lift_layers,
                         const PredictVerb& o) {
  std::vector<SurfacePoint> points = prediction.points;
  if (o.frame == "part") {
    const auto lift_mm = static_cast<float>(lift_layers * model.layer_mm);
    for (SurfacePoint& point : points) point.z_mm -= lift_mm;
  }
  const auto comment = fmt::format("predicted by telefab-fab, millimetres, {} frame", o.frame);
  if (auto ok = write_file_atomically(o.out, to_ply(points, comment)); !ok) return ok;
  if (o.report)
    if (auto ok = write_file_atomically(*o.report, to_json(prediction, model)); !ok) return ok;
  if (!o.preview) return {};
  const auto png = encode_png(prediction.picture);
  if (!png) return tl::unexpected{png.error()};
  return write_file_atomically(*o.preview, *png);
}

Result<ExitCode> predict(const PredictVerb& o, std::stop_token stop) {
  const auto job = PlannedJob::open(o.folder);
  if (!job) return tl::unexpected{job.error()};
  const auto machines = load_machine_profiles(o.machines);
  if (!machines) return tl::unexpected{machines.error()};
  const auto machine = find_machine(*machines, o.machine.empty() ? (*job)->plan().machine : o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  PredictOptions options;
  options.sub_pixels = o.sub_pixels;
  options.spacing_px = o.spacing_px;
  options.supports = o.supports;
  options.threads = o.threads;
  if (o.layer) options.picture = LayerIndex{*o.layer};
  const auto made = predict_plan(o.folder, *machine, o.contours, options, progress_line(), stop);
  clear_progress();
  if (!made) return tl::unexpected{made.error()};
  if (auto ok = write_files(made->prediction, made->model, made->lift_layers, o); !ok)
    return tl::unexpected{ok.error()};
  if (o.json)
    fmt::print("{}", to_json(made->prediction, made->model));
  else
    tell(made->prediction, made->model, made->is_compared);
  if (made->leaked >= 0.5)
    fmt::print(stderr,
               "telefab-fab: black pixels leak {:.2f} of the critical dose in a tall print; all resin sets at 1\n",
               made->leaked);
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_predict(CLI::App& options) {
  auto o = std::make_shared<PredictVerb>();
  options.add_option("DIR", o->folder, "a plan folder, as `telefab-fab plan` writes it")->required();
  options.add_option("--out", o->out, "write the cured part's surface points with normals here (PLY)")->required();
  options.add_option("--report", o->report, "write edge errors, by layer and overall, here (JSON)");
  options.add_option("--preview", o->preview, "write a picture here (PNG)");
  options.add_option("--contours", o->contours,
                     "the .tfc file it was planned of; default: the one in the folder, where there is one");
  options.add_option("--machine", o->machine, "profile whose optics and resin are taken; default: the plan's");
  options.add_option("--machines", o->machines, "folder of machine profiles (*.toml)")->capture_default_str();
  options.add_option("--frame", o->frame, "part: z from the part's first layer; print: z from the platform")
      ->check(CLI::IsMember({"part", "print"}))
      ->capture_default_str();
  options.add_flag("--supports", o->supports, "write the supports' points as well");
  options.add_option("--layer", o->layer,
                     "print layer whose edges the picture shows; default: the one of most contour");
  options.add_option("--sub-pixels", o->sub_pixels, "samples of the solid a pixel and axis")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  options.add_option("--spacing-px", o->spacing_px, "distance of surface points, pixels")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  options.add_option("--threads", o->threads, "0: all cores; the prediction is the same for any number")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  options.add_flag("--json", o->json, "print the report as JSON");
  return [o](std::stop_token stop) { return predict(*o, stop); };
}

}  // namespace telefab::fab
