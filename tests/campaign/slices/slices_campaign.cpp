// SPDX-License-Identifier: GPL-3.0-or-later
// Every mesh of some folders sliced as a cloud, by its corners or by samples, and surfaces known by formula by samples;
// judged by exact sections: layers certified, flagged and wrong, Euler number, distance to the truth. Run by hand.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <Eigen/Geometry>
#include <algorithm>
#include <filesystem>
#include <functional>
#include <numbers>
#include <random>
#include <telefab/base/file.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

#include <telefab/test/mesh_truth.hpp>
#include "layer_picture.hpp"
#include "shape_truth.hpp"

namespace telefab::campaign {
namespace {

using test::MeshTruth;
using test::read_mesh;
using test::RingCount;
using test::Vec3;

namespace fs = std::filesystem;

struct Setup {
  std::vector<std::string> folders;
  std::vector<std::string> shapes;
  std::vector<std::string> only;
  std::vector<int> turns{0};
  double height_mm = 100;
  std::uint32_t layers = 100;
  std::string surface = "unbiased";
  std::string method = "auto";
  double kernel_spacings = 0;
  std::size_t samples = 0;
  double noise_diagonals = 0;
  double noise_spacings = 0;
  std::string normals = "given";
  std::uint64_t seed = 1;
  double chord_mm = 0.014;
  bool distances = true;
  bool reasons = false;
  std::string draw;
};

/// Orientations: as it stands, on its side, on its face, and on no face at all.
Transform4 turn_of(int number) {
  using Axis = Eigen::AngleAxisd;
  const auto degrees = [](double d) { return d * std::numbers::pi / 180; };
  Eigen::Matrix3d r = Eigen::Matrix3d::Identity();
  if (number == 1) r = Axis{degrees(90), Vec3::UnitX()}.toRotationMatrix();
  if (number == 2) r = Axis{degrees(90), Vec3::UnitY()}.toRotationMatrix();
  if (number >= 3) {
    // Any other number is a seed of its own.
    std::mt19937_64 random{static_cast<std::uint64_t>(number)};
    std::normal_distribution<double> bell;
    r = Eigen::Quaterniond{bell(random), bell(random), bell(random), bell(random)}.normalized().toRotationMatrix();
  }
  return {r(0, 0), r(0, 1), r(0, 2), 0, r(1, 0), r(1, 1), r(1, 2), 0, r(2, 0), r(2, 1), r(2, 2), 0, 0, 0, 0, 1};
}

struct Tally {
  int certified = 0, flagged = 0, wrong = 0, flagged_wrong = 0, critical = 0;
};

/// What is known of the object in the build frame, without any scan.
struct Truth {
  std::function<RingCount(double z, double least_width)> rings;
  std::function<std::vector<std::array<Point2, 2>>(double z)> section;  ///< unset: not to be drawn
  std::function<double(const Vec3&)> distance;
  int euler = 0;
};

/// Slices the cloud and prints its row. `spacing` in the cloud's unit; `truth_at` places the truth.
Result<Tally> row(const std::string& name, int turn, const scan::PointCloud& cloud, double spacing,
                  const std::function<Truth(const Transform4&)>& truth_at, const Setup& setup) {
  scan::SliceRequest request;
  request.machine.name = "campaign";
  request.machine.platform = {1e4, 1e4, 1e4};
  request.machine.projection.pixel_pitch_mm = 0.14;
  request.machine.layers.thickness_mm = 0.1;
  request.placement.height_mm = setup.height_mm;
  request.layer_mm = std::min(1.0, setup.height_mm / setup.layers);
  request.chord_mm = setup.chord_mm;
  const auto surface = scan::surface_kind_from(setup.surface);
  const auto method = scan::trace_method_from(setup.method);
  if (!surface) return tl::unexpected{surface.error()};
  if (!method) return tl::unexpected{method.error()};
  request.mls.surface = *surface;
  request.method = *method;
  if (setup.kernel_spacings > 0) {
    const auto [low, high] = std::minmax_element(cloud.points.begin(), cloud.points.end(),
                                                 [](const auto& a, const auto& b) { return a.z() < b.z(); });
    request.mls.kernel_mm = setup.kernel_spacings * spacing * setup.height_mm / (high->z() - low->z());
  }
  std::vector<Layer> layers;
  const auto take = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    layers.push_back(std::move(layer));
    return {};
  };
  const auto report = scan::slice_scan(scan::write_ply(cloud, {}, "campaign"), name, request, take, {}, {});
  if (!report) return tl::unexpected{report.error()};

  const Truth truth = truth_at(report->header.scan_to_build);
  Tally tally;
  std::string lines;
  std::vector<double> off;
  std::mt19937_64 random{1};
  std::uniform_real_distribution<double> even;
  for (const Layer& layer : layers) {
    RingCount found;
    for (const Contour& ring : layer.contours) ++(ring.is_hole() ? found.holes : found.outers);
    const RingCount exact = truth.rings(layer.z_mm, 0);
    const bool certified = layer.certificate.is_certified();
    ++(certified ? tally.certified : tally.flagged);
    bool differs = !(found == exact);
    if (differs) {
      // Within 0.1 h of a critical height the count may be that of either side; so it may beside a ring that an offset
      // of as much would close.
      bool near = truth.rings(layer.z_mm, 0.1 * report->kernel.kernel_mm) == found;
      for (const double share : {-0.1, -0.05, 0.05, 0.1})
        near = near || truth.rings(layer.z_mm + share * report->kernel.kernel_mm, 0) == found;
      if (near) ++tally.critical;
      differs = !near;
    }
    if (differs) ++(certified ? tally.wrong : tally.flagged_wrong);
    if ((differs && certified) || (setup.reasons && !certified)) {
      const auto place = layer.certificate.doubt.value_or(Doubt{}).place.value_or(Point2{});
      lines += fmt::format("    {} {} layer {} at {:.3f} mm: {}+{} rings, exact {}+{}; {} ({:.2f}, {:.2f})\n",
                           differs ? "WRONG" : "right", certified ? "certified" : "flagged", layer.index.count(),
                           layer.z_mm, found.outers, found.holes, exact.outers, exact.holes,
                           sentence_of(layer.certificate), place.x_mm, place.y_mm);
    }
    if (differs && certified && !setup.draw.empty() && truth.section) {
      const std::string picture = picture_of(layer, truth.section(layer.z_mm));
      const auto file = fmt::format("{}/{}_{}_{}.svg", setup.draw, name, turn, layer.index.count());
      if (auto ok = write_file_atomically(file, std::as_bytes(std::span{picture})); !ok)
        return tl::unexpected{ok.error()};
    }
    if (!setup.distances) continue;
    for (const Contour& ring : layer.contours) {
      const auto v = ring.vertices();
      for (std::size_t i = 0; i < v.size(); ++i) {
        const Point2 &a = v[i], &b = v[(i + 1) % v.size()];
        const double t = even(random);
        off.push_back(truth.distance({a.x_mm, a.y_mm, layer.z_mm}));
        off.push_back(truth.distance({a.x_mm + t * (b.x_mm - a.x_mm), a.y_mm + t * (b.y_mm - a.y_mm), layer.z_mm}));
      }
    }
  }
  std::string distance = "-";
  if (!off.empty()) {
    std::sort(off.begin(), off.end());
    double sum = 0;
    for (const double d : off) sum += d;
    const double percent = 100 / setup.height_mm;
    distance = fmt::format("{:.4f}/{:.4f}/{:.4f}", percent * sum / static_cast<double>(off.size()),
                           percent * off[off.size() * 95 / 100], percent * off.back());
  }
  double seconds = 0;
  for (const auto& t : report->times) seconds += t.seconds;
  fmt::print("{:22} {:3} {:6} {:5.2f} {:5.2f} {:5.1f} {:5} {:4} {:5} {:5} {:4} {:>9} {:22} {:6.2f}\n", name, turn,
             cloud.points.size(), report->kernel.kernel_mm / report->kernel.spacing_mm,
             report->kernel.noise_mm / report->kernel.spacing_mm, report->kernel.unevenness, tally.certified,
             tally.flagged, tally.wrong, tally.flagged_wrong, tally.critical,
             fmt::format("{}/{}", report->surface_euler ? fmt::format("{}", *report->surface_euler) : "?", truth.euler),
             distance, seconds);
  fmt::print("{}", lines);
  if (setup.reasons)
    for (const std::string& each : report->inconsistencies) fmt::print("    inconsistent: {}\n", each);
  std::fflush(stdout);
  return tally;
}

Result<Tally> mesh_row(const fs::path& path, int turn, const Setup& setup) {
  const auto read = read_mesh(path);
  if (!read) return tl::unexpected{read.error()};
  const MeshTruth mesh = read->moved(turn_of(turn));
  Vec3 low = mesh.corners()[0], high = low;
  for (const Vec3& p : mesh.corners()) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const std::size_t count = setup.samples > 0 ? setup.samples : mesh.corners().size();
  const double spacing = std::sqrt(mesh.area() / static_cast<double>(count));
  const double noise = setup.noise_diagonals * (high - low).norm() + setup.noise_spacings * spacing;
  const double tilt = setup.normals == "tilted" ? 0.3 * noise / spacing : 0;
  scan::PointCloud cloud =
      setup.samples > 0 || noise > 0 ? mesh.sampled(count, noise, tilt, setup.seed) : mesh.as_scanned();
  if (setup.normals == "none") cloud.normals.clear();
  const auto truth_at = [&](const Transform4& placed) {
    const auto truth = std::make_shared<MeshTruth>(mesh.moved(placed));
    return Truth{[truth](double z, double least_width) { return truth->rings(z, least_width); },
                 [truth](double z) { return truth->section(z); }, [truth](const Vec3& p) { return truth->distance(p); },
                 truth->euler()};
  };
  return row(path.stem().string(), turn, cloud, spacing, truth_at, setup);
}

Result<Tally> shape_row(const std::string& name, int turn, const Setup& setup) {
  auto shape = ShapeTruth::named(name, turn);
  if (!shape) return tl::unexpected{shape.error()};
  const std::size_t count = setup.samples > 0 ? setup.samples : 60'000;
  const double spacing = shape->spacing_of(count);
  const double noise = setup.noise_spacings * spacing;
  scan::PointCloud cloud =
      shape->sampled(spacing, noise, setup.normals == "tilted" ? 0.3 * noise / spacing : 0, setup.seed);
  if (setup.normals == "none") cloud.normals.clear();
  const auto truth_at = [&](const Transform4& placed) {
    const auto truth = std::make_shared<ShapeTruth>(*shape);
    truth->place(placed);
    return Truth{[truth](double z, double) { return truth->rings(z); },
                 {},
                 [truth](const Vec3& p) { return truth->distance(p); },
                 truth->euler()};
  };
  return row(name, turn, cloud, spacing, truth_at, setup);
}

int run(const Setup& setup) {
  std::vector<fs::path> meshes;
  for (const std::string& folder : setup.folders)
    for (const auto& entry : fs::recursive_directory_iterator{folder}) {
      const std::string end = entry.path().extension().string();
      if (end != ".ply" && end != ".off" && end != ".stl") continue;
      const std::string name = entry.path().stem().string();
      const auto wanted = [&](const std::string& part) { return name.find(part) != std::string::npos; };
      if (setup.only.empty() || std::any_of(setup.only.begin(), setup.only.end(), wanted))
        meshes.push_back(entry.path());
    }
  std::sort(meshes.begin(), meshes.end());
  fmt::print(
      "WRONG: certified, but the count differs from the exact section; fwr: flagged and so; crit: differs within "
      "0.1 h of a critical height\n{:22} {:>3} {:>6} {:>5} {:>5} {:>5} {:>5} {:>4} {:>5} {:>5} {:>4} {:>9} {:22} "
      "{:>6}\n",
      "mesh", "t", "points", "h/s", "nois", "unev", "cert", "flag", "WRONG", "fwr", "crit", "chi/true", "mean/95/max %",
      "s");
  Tally all;
  const auto add = [&](const std::string& name, int turn, const Result<Tally>& done) {
    if (!done) {
      fmt::print("{:22} {:3} not sliced: {}\n", name, turn, done.error().what);
      return;
    }
    all.certified += done->certified;
    all.flagged += done->flagged;
    all.wrong += done->wrong;
    all.flagged_wrong += done->flagged_wrong;
    all.critical += done->critical;
  };
  for (const fs::path& mesh : meshes)
    for (const int turn : setup.turns) add(mesh.stem().string(), turn, mesh_row(mesh, turn, setup));
  for (const std::string& shape : setup.shapes)
    for (const int turn : setup.turns) add(shape, turn, shape_row(shape, turn, setup));
  fmt::print("{} certified, of them {} wrong; {} flagged, of them {} wrong; {} differ near a critical height\n",
             all.certified, all.wrong, all.flagged, all.flagged_wrong, all.critical);
  return all.wrong == 0 ? 0 : 8;
}

}  // namespace
}  // namespace telefab::campaign

int main(int argc, char** argv) {
  telefab::campaign::Setup setup;
  CLI::App options{"Slices every closed mesh of some folders as a cloud and judges each layer by the exact section."};
  options.add_option("FOLDER", setup.folders, "folders of meshes (PLY, OFF, STL)");
  options
      .add_option("--shapes", setup.shapes, "surfaces known by formula: torus, genus-two, bumpy, balls, wall, gyroid")
      ->delimiter(',');
  options.add_option("--only", setup.only, "parts of names")->delimiter(',');
  options.add_option("--turns", setup.turns, "orientations: 0 as it is, 1 and 2 on a side, others at random")
      ->delimiter(',');
  options.add_option("--height-mm", setup.height_mm);
  options.add_option("--layers", setup.layers);
  options.add_option("--surface", setup.surface);
  options.add_option("--method", setup.method);
  options.add_option("--kernel-spacings", setup.kernel_spacings, "0: chosen by the slicer");
  options.add_option("--samples", setup.samples, "0: the corners are the cloud");
  options.add_option("--noise-diagonals", setup.noise_diagonals);
  options.add_option("--noise-spacings", setup.noise_spacings);
  options.add_option("--normals", setup.normals, "given | tilted (0.3 rad a spacing of noise) | none");
  options.add_option("--seed", setup.seed);
  options.add_option("--chord-mm", setup.chord_mm);
  options.add_flag("!--no-distances", setup.distances);
  options.add_option("--draw", setup.draw,
                     "folder for pictures (SVG) of layers of meshes that are certified and wrong");
  options.add_flag("--reasons", setup.reasons, "also list flagged layers and inconsistencies");
  CLI11_PARSE(options, argc, argv);
  return telefab::campaign::run(setup);
}
