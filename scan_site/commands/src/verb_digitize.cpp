// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <filesystem>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/digitize/digitize.hpp>
#include <telefab/scan/digitize/models.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/placing/turn.hpp>
#include <telefab/scan/registration/pose_file.hpp>

#include "cloud_files.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

struct Options {
  std::string model, shape, folder, reference, rotate, units = "mm";
  std::optional<double> scale, height_mm;
  std::vector<double> tilts_deg{0};
  DigitizeOptions digitize;
};

Result<DigitizeModel> load_model(const Options& o, std::stop_token stop) {
  if (!o.shape.empty()) return shape_model(o.shape, o.height_mm.value_or(50));
  const auto bytes = read_file(o.model, kMaxScanFileBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  const auto file = read_scan_file(*bytes, name_of_file(o.model), {.keep_faces = true}, stop);
  if (!file) return tl::unexpected{file.error()};
  const auto unit = millimetres_per(o.units);
  if (!unit) return tl::unexpected{unit.error()};
  DigitizeModel model;
  if (file->faces.empty()) {
    auto surfels = surfel_model(file->cloud);
    if (!surfels) return fail_in(name_of_file(o.model), surfels.error());
    model = std::move(*surfels);
  } else {
    model.triangles = file->faces;
    for (const auto& p : file->cloud.points) model.points.emplace_back(file->cloud.origin + p.cast<double>());
    if (face_outward(model)) write_note("note: the faces of the model look inward and are turned round\n");
  }
  for (Vec3& p : model.points) p *= *unit * o.scale.value_or(1);
  if (o.height_mm) scale_to_height(model, *o.height_mm);
  return model;
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  if (o.model.empty() == o.shape.empty())
    return fail(ErrorCode::InvalidInput, "give a model to look at, or --shape, and not both");
  const auto model = load_model(o, stop);
  if (!model) return tl::unexpected{model.error()};
  std::error_code fault;
  std::filesystem::create_directories(o.folder, fault);
  if (fault) return fail(ErrorCode::NotPermitted, fmt::format("{}: {}", o.folder, fault.message()));
  Turn laid;
  if (!o.rotate.empty()) {
    const auto turn = turn_from_rotate(o.rotate);
    if (!turn) return fail_in("--rotate", turn.error());
    laid = *turn;
  }
  DigitizeModel on_table = *model;
  for (Vec3& p : on_table.points) p = laid.matrix() * p;
  const RigidMotion to_model{Eigen::Matrix3d{laid.matrix().transpose()}};
  std::vector<NamedPose> poses;
  std::size_t points = 0;
  for (std::size_t turn = 0; turn < o.tilts_deg.size(); ++turn) {
    DigitizeOptions options = o.digitize;
    options.tilt_deg = o.tilts_deg[turn];
    options.seed += turn;
    const auto views = digitize(on_table, options, stop);
    if (!views) return fail_in(o.shape.empty() ? name_of_file(o.model) : o.shape, views.error());
    for (const VirtualView& view : *views) {
      poses.push_back({fmt::format("view_{:03}.ply", poses.size()), to_model * view.scanner_to_model});
      points += view.points.size();
      const auto ply = write_range_ply(view.points, view.view, "virtual range image, mm");
      if (auto ok = write_file_atomically(std::filesystem::path{o.folder} / poses.back().file, ply); !ok)
        return tl::unexpected{ok.error()};
    }
  }
  if (points == 0)
    return fail(
        ErrorCode::InvalidInput,
        "no view shows any of the model: its surface lies flatter to the scanner than --grazing-deg, or is finer "
        "than --pitch-mm");
  if (auto ok = write_file_atomically(std::filesystem::path{o.folder} / "poses.conf", to_pose_file(poses)); !ok)
    return tl::unexpected{ok.error()};
  if (!o.reference.empty()) {
    const PointCloud truth = reference_cloud(*model, o.digitize.pitch_mm / 2, o.digitize.seed);
    if (auto ok = write_file_atomically(o.reference, write_ply(truth, {}, "points of the model itself, mm")); !ok)
      return tl::unexpected{ok.error()};
  }
  write_output(fmt::format("{} range images, {} points, and their true poses in {}\n", poses.size(), points, o.folder));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_digitize(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  DigitizeOptions& d = o->digitize;
  options.add("MODEL", o->model,
              "a mesh (PLY, OFF or STL with faces), or a cloud with normals such as `telefab-fab predict` writes");
  options.add("--shape", o->shape, "instead of a file: sphere, torus or knot").one_of({"sphere", "torus", "knot"});
  options.add_output("--out", o->folder, "folder for view_000.ply .. and poses.conf").required();
  options.add("--units", o->units, "unit of the model (mm, cm, m, in)").shows_default();
  const Option scale = options.add("--scale", o->scale, "times which the model is made larger first");
  options.add("--height-mm", o->height_mm, "make the model this high along z; a shape without it: 50")
      .above_zero()
      .excludes(scale);
  scale.above_zero();
  options.add(
      "--rotate", o->rotate,
      "lay the model on another side first, X,Y,Z degrees about its axes as for slice: a series turned over; poses "
      "and reference stay in the model's frame");
  options.add_output("--reference", o->reference,
                     "also write points of the model itself, with normals, to measure against (PLY)");
  options.add("--step-deg", d.step_deg, "turn of the table between views").shows_default();
  options.add("--views", d.views, "number of views; 0: a whole turn").shows_default();
  options.add("--pitch-mm", d.pitch_mm, "distance of neighbouring cells").shows_default();
  options
      .add("--tilt-deg", o->tilts_deg, "how far the scanner looks down; several, as 30,-30: one turn of the table each")
      .separated_by(',')
      .shows_default();
  options.add("--noise-mm", d.noise_mm, "sigma along the line of sight").shows_default();
  options.add("--outliers", d.outlier_share, "share of points with a random depth").shows_default();
  options.add("--mixed", d.mixed_share, "share of cells at depth edges that mix both depths").shows_default();
  options.add("--grazing-deg", d.grazing_deg, "largest angle between normal and line of sight that returns a point")
      .shows_default();
  options.add("--seed", d.seed, "same seed, same images").shows_default();
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
