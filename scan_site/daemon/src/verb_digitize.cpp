#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/cloud/write_cloud.hpp>
#include <telefab/scan/digitize/digitize.hpp>
#include <telefab/scan/registration/pose_file.hpp>

#include "cloud_files.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

struct Options {
  std::string model, folder, units = "mm";
  double scale = 1;
  DigitizeOptions digitize{.tilt_deg = 0};
};

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto bytes = read_file(o.model, kMaxScanFileBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  const auto file = read_scan_file(*bytes, name_of_file(o.model), {.keep_faces = true}, stop);
  if (!file) return tl::unexpected{file.error()};
  const auto unit = millimetres_per(o.units);
  if (!unit) return tl::unexpected{unit.error()};
  if (!(o.scale > 0)) return fail(ErrorCode::InvalidInput, fmt::format("--scale {}: must be above 0", o.scale));
  DigitizeModel model;
  model.triangles = file->faces;
  for (const auto& p : file->cloud.points)
    model.points.emplace_back((file->cloud.origin + p.cast<double>()) * (*unit * o.scale));
  const auto views = digitize(model, o.digitize, stop);
  if (!views) return fail_in(name_of_file(o.model), views.error());
  std::error_code fault;
  std::filesystem::create_directories(o.folder, fault);
  if (fault) return fail(ErrorCode::NotPermitted, fmt::format("{}: {}", o.folder, fault.message()));
  std::vector<NamedPose> poses;
  std::size_t points = 0;
  for (std::size_t v = 0; v < views->size(); ++v) {
    const VirtualView& view = (*views)[v];
    poses.push_back({fmt::format("view_{:03}.ply", v), view.scanner_to_model});
    points += view.points.size();
    const auto ply = write_range_ply(view.points, view.view, "virtual range image, mm");
    if (auto ok = write_file_atomically(std::filesystem::path{o.folder} / poses.back().file, ply); !ok)
      return tl::unexpected{ok.error()};
  }
  if (auto ok = write_file_atomically(std::filesystem::path{o.folder} / "poses.conf", to_pose_file(poses)); !ok)
    return tl::unexpected{ok.error()};
  fmt::print("{} range images, {} points, and their true poses in {}\n", views->size(), points, o.folder);
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_digitize(CLI::App& options) {
  auto o = std::make_shared<Options>();
  DigitizeOptions& d = o->digitize;
  options.add_option("model", o->model, "a mesh: PLY, OFF or STL with faces")->required();
  options.add_option("--out", o->folder, "folder for view_000.ply .. and poses.conf")->required();
  options.add_option("--units", o->units, "unit of the model (mm, cm, m, in)")->capture_default_str();
  options.add_option("--scale", o->scale, "times which the model is made larger first")->capture_default_str();
  options.add_option("--step-deg", d.step_deg, "turn of the table between views")->capture_default_str();
  options.add_option("--views", d.views, "number of views; 0: a whole turn")->capture_default_str();
  options.add_option("--pitch-mm", d.pitch_mm, "distance of neighbouring cells")->capture_default_str();
  options.add_option("--tilt-deg", d.tilt_deg, "how far the scanner looks down")->capture_default_str();
  options.add_option("--noise-mm", d.noise_mm, "sigma along the line of sight")->capture_default_str();
  options.add_option("--outliers", d.outlier_share, "share of points with a random depth")->capture_default_str();
  options.add_option("--mixed", d.mixed_share, "share of cells at depth edges that mix both depths")
      ->capture_default_str();
  options
      .add_option("--grazing-deg", d.grazing_deg, "largest angle between normal and line of sight that returns a point")
      ->capture_default_str();
  options.add_option("--seed", d.seed, "same seed, same images")->capture_default_str();
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
