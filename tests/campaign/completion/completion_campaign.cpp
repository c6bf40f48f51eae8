// SPDX-License-Identifier: GPL-3.0-or-later
// Closed meshes as clouds, damaged as scanners do, sliced, and held against the mesh: distances along the contours,
// volume wrong, layers wrong, layers certified, error of completed stretches against the bound they state. Run by hand.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <telefab/base/file.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

#include <telefab/test/damage.hpp>
#include <telefab/test/mesh_truth.hpp>
#include <telefab/test/poisson.hpp>
#include "layer_picture.hpp"
#include "section.hpp"

namespace telefab::campaign {
namespace {

using test::Damage;
using test::MeshTruth;
using test::read_mesh;
using test::RingCount;
using test::Vec3;

namespace fs = std::filesystem;

constexpr double kHeightMm = 75;
constexpr double kLayerMm = 0.15;
constexpr double kStepMm = 0.25;
/// Layers whose true count changes within this share of the height are nobody's fault.
constexpr double kCriticalShare = 0.004;
/// Heights on either side, within that share, at which the mesh's count is looked at.
constexpr int kHeightsBeside = 8;

struct Setup {
  std::vector<std::string> meshes;
  std::vector<std::string> damages{"whole",  "holes3", "holes5",    "off3", "off10",
                                   "noise1", "noise2", "density10", "two",  "all"};
  std::vector<std::uint64_t> seeds{1};
  bool complete = true;
  bool poisson = false;
  std::uint32_t judged = 10;  ///< every so many-th layer is held against the mesh
  bool list = false;
  bool reasons = false;
  bool verdicts = false;
  std::string save;
  std::string against;
  bool wrong = false;
  std::string draw;
};

double rank(std::vector<double>& values, double share) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

RingCount count_of(const Layer& layer) {
  RingCount count;
  for (const Contour& ring : layer.contours) ++(ring.is_hole() ? count.holes : count.outers);
  return count;
}

struct Judgement {
  std::vector<double> off_mm;
  std::vector<double> error_shares;  ///< of completed edges: distance over the error they state
  double truth_mm2 = 0, wrong_mm2 = 0;
  int wrong = 0, wrong_certified = 0, critical = 0;
  struct Flagged {
    int right = 0, wrong = 0;
  };
  std::map<std::string, Flagged, std::less<>> flagged;  ///< by reason

  /// Whether the mesh has as many rings a little higher or lower, or changes its count from here to there: a ring that
  /// begins and soon joins another leaves no trace on either side.
  static bool near_critical(RingCount count, double z_mm, const MeshTruth& truth) {
    const double near = kCriticalShare * kHeightMm;
    if (!(truth.rings(z_mm - near) == truth.rings(z_mm + near))) return true;
    for (int i = -kHeightsBeside; i <= kHeightsBeside; ++i)
      if (truth.rings(z_mm + near * i / kHeightsBeside) == count) return true;
    return false;
  }

  /// Whether it has as many rings as the mesh.
  bool judge(std::span<const Segment> found, RingCount count, double z_mm, const MeshTruth& truth) {
    const auto exact = truth.section(z_mm);
    const SectionAreas areas = compare_sections(found, exact, 0.1);
    truth_mm2 += areas.truth_mm2;
    wrong_mm2 += areas.wrong_mm2;
    for (const Point2& p : along(found, kStepMm)) off_mm.push_back(truth.distance({p.x_mm, p.y_mm, z_mm}));
    if (count == truth.rings(z_mm)) return true;
    ++(near_critical(count, z_mm, truth) ? critical : wrong);
    return false;
  }

  void judge(const Layer& layer, const MeshTruth& truth) {
    for (const Contour& ring : layer.contours) {
      std::size_t edge = 0;
      for (const SurfaceRun& run : one_an_edge(ring.runs(), ring.vertices().size())) {
        const Point2 p = ring.vertices()[edge++];
        if (run.kind == SurfaceClass::Completed && run.error_mm > 0)
          error_shares.push_back(truth.distance({p.x_mm, p.y_mm, layer.z_mm}) / run.error_mm);
      }
    }
    const int wrong_before = wrong;
    const bool right = judge(segments_of(layer.contours), count_of(layer), layer.z_mm, truth);
    if (layer.certificate.verdict == LayerCertificate::Verdict::Doubtful) {
      Flagged& verdict = flagged[std::string{name_of(layer.certificate.doubt->reason)}];
      ++(right ? verdict.right : verdict.wrong);
    }
    wrong_certified += layer.certificate.is_certified() ? wrong - wrong_before : 0;
  }

  [[nodiscard]] double mean_mm() const {
    double sum = 0;
    for (const double d : off_mm) sum += d;
    return off_mm.empty() ? 0 : sum / static_cast<double>(off_mm.size());
  }
};

/// Sections of a mesh that another program made of the same points, at the heights of the layers judged.
void judge_other(std::string_view name, const MeshTruth& other, std::span<const Layer> layers, const MeshTruth& truth,
                 const Setup& setup) {
  Judgement found;
  for (const Layer& layer : layers)
    if (layer.index.count() % setup.judged == setup.judged / 2)
      found.judge(other.section(layer.z_mm), other.rings(layer.z_mm), layer.z_mm, truth);
  const double percent = 100 / kHeightMm;
  fmt::print("    {:70} {:4} {:4} {:3} {:6.4f} {:6.4f} {:6.3f}\n", name, found.wrong, "", found.critical,
             percent * found.mean_mm(), percent * rank(found.off_mm, 0.95), 100 * found.wrong_mm2 / found.truth_mm2);
}

/// How a layer came out, and how it should have.
std::string line_of(const Layer& layer, const MeshTruth& truth) {
  const RingCount found = count_of(layer), exact = truth.rings(layer.z_mm);
  const auto& doubt = layer.certificate.doubt;
  const Point2 place = doubt && doubt->place ? *doubt->place : Point2{};
  return fmt::format("    layer {:4} at {:7.3f} mm: {}+{} rings, exact {}+{}, {} {} ({:.1f}, {:.1f}) {:.3g}\n",
                     layer.index.count(), layer.z_mm, found.outers, found.holes, exact.outers, exact.holes,
                     found == exact ? "right" : "WRONG", doubt ? name_of(doubt->reason) : "certified", place.x_mm,
                     place.y_mm, doubt ? doubt->size_mm : 0);
}

Result<void> row(const fs::path& path, const MeshTruth& mesh, const std::string& damage_name, std::uint64_t seed,
                 const Setup& setup) {
  const auto damage = Damage::named(damage_name, seed);
  if (!damage) return tl::unexpected{damage.error()};
  const scan::PointCloud whole = mesh.as_scanned();
  const scan::PointCloud cloud = test::damaged(whole, *damage);
  const auto [low, high] = std::minmax_element(whole.points.begin(), whole.points.end(),
                                               [](const auto& a, const auto& b) { return a.z() < b.z(); });
  scan::SliceRequest request;
  request.machine.name = "campaign";
  request.machine.platform = {1e4, 1e4, 1e4};
  request.machine.projection.pixel_pitch_mm = 0.14;
  request.placement.scale = kHeightMm / static_cast<double>(high->z() - low->z());
  request.layer_mm = kLayerMm;
  request.complete = setup.complete;
  std::vector<Layer> layers;
  const auto take = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    layers.push_back(std::move(layer));
    return {};
  };
  const auto bytes = scan::write_ply(cloud, {}, "campaign");
  if (!setup.save.empty())
    if (auto ok =
            write_file_atomically(fmt::format("{}/{}_{}_{}.ply", setup.save, path.stem().string(), damage_name, seed),
                                  std::span<const std::byte>{bytes});
        !ok)
      return ok;
  const auto began = std::chrono::steady_clock::now();
  const auto report = scan::slice_scan(bytes, path.filename().string(), request, take, {}, {});
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  if (!report) return tl::unexpected{report.error()};
  const MeshTruth truth = mesh.moved(report->header.scan_to_build);
  Judgement found;
  std::vector<const Layer*> wrong_certified;
  std::string lines;
  for (const Layer& layer : layers)
    if (layer.index.count() % setup.judged == setup.judged / 2) {
      const int before = found.wrong_certified;
      found.judge(layer, truth);
      if (found.wrong_certified > before) wrong_certified.push_back(&layer);
      if (setup.list) lines += line_of(layer, truth);
    }
  const double percent = 100 / kHeightMm;
  const auto seconds_of = [&](std::string_view stage) {
    double sum = 0;
    for (const auto& t : report->times) sum += t.stage == stage ? t.seconds : 0;
    return sum;
  };
  fmt::print(
      "{:18} {:10} {:2} {:7} {:6} {:6.2f} {:4}/{:3}/{:3} {:5} {:4} {:4} {:3} {:6.4f} {:6.4f} {:6.3f} {:5.3f} {:6.2f} "
      "{:6.2f} {:6.2f}\n",
      path.stem().string(), damage_name, seed, cloud.size(), report->completion.virtual_samples,
      100 * report->open.share(), report->certified - report->completed, report->completed, report->flagged.size(),
      report->contours, found.wrong, found.wrong_certified, found.critical, percent * found.mean_mm(),
      percent * rank(found.off_mm, 0.95), 100 * found.wrong_mm2 / found.truth_mm2, rank(found.error_shares, 0.95),
      seconds_of("gaps"), seconds_of("contours"), seconds);
  fmt::print("{}", lines);
  for (const Layer* layer : wrong_certified) {
    if (setup.wrong) {
      const RingCount found_rings = count_of(*layer), exact = truth.rings(layer->z_mm);
      fmt::print("    WRONG certified layer {} at {:.3f} mm: {}+{} rings, exact {}+{}\n", layer->index.count(),
                 layer->z_mm, found_rings.outers, found_rings.holes, exact.outers, exact.holes);
    }
    if (setup.draw.empty()) continue;
    const std::string picture = picture_of(*layer, truth.section(layer->z_mm));
    const auto name =
        fmt::format("{}/{}_{}_{}_{}.svg", setup.draw, path.stem().string(), damage_name, seed, layer->index.count());
    if (auto ok = write_file_atomically(name, std::as_bytes(std::span{picture})); !ok) return ok;
  }
  if (setup.reasons)
    for (const auto& f : report->flagged)
      fmt::print("    {} z {:.2f}: {}\n", f.layer.count(), f.z_mm, sentence_of(f.certificate));
  if (!setup.against.empty()) {
    const auto name = fmt::format("{}/{}_{}_{}.ply", setup.against, path.stem().string(), damage_name, seed);
    if (const auto other = read_mesh(name, false); !other)
      fmt::print("    {}: {}\n", name, other.error().what);
    else
      judge_other("the other", other->moved(report->header.scan_to_build), layers, truth, setup);
  }
  if (setup.poisson) {
    const auto start = std::chrono::steady_clock::now();
    const auto other = test::poisson_faces(cloud);
    if (!other) return tl::unexpected{other.error()};
    const double took = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const MeshTruth mesh_found{other->corners, other->faces};
    judge_other(fmt::format("Poisson, {:.2f} s", took), mesh_found.moved(report->header.scan_to_build), layers, truth,
                setup);
  }
  if (setup.verdicts)
    for (const auto& [reason, verdict] : found.flagged)
      fmt::print("    {:22} {:4} layers flagged though right, {:4} wrong\n", reason, verdict.right, verdict.wrong);
  std::fflush(stdout);
  return {};
}

int run(const Setup& setup) {
  fmt::print("{:18} {:10} {:2} {:7} {:6} {:6} {:12} {:5} {:4} {:4} {:3} {:6} {:6} {:6} {:5} {:6} {:6} {:6}\n", "mesh",
             "damage", "s", "points", "added", "open%", "meas/comp/dbt", "rings", "WRG", "cert", "cr", "mean%", "95%",
             "xor%", "err95", "gaps s", "cont s", "all s");
  for (const std::string& name : setup.meshes) {
    const auto mesh = read_mesh(name);
    if (!mesh) {
      fmt::print("{}: {}\n", name, mesh.error().what);
      continue;
    }
    for (const std::string& damage : setup.damages)
      for (const std::uint64_t seed : setup.seeds)
        if (auto done = row(name, *mesh, damage, seed, setup); !done)
          fmt::print("{:18} {:10} {:2} not sliced: {}\n", fs::path{name}.stem().string(), damage, seed,
                     done.error().what);
  }
  return 0;
}

}  // namespace
}  // namespace telefab::campaign

int main(int argc, char** argv) {
  telefab::campaign::Setup setup;
  CLI::App options{"Slices closed meshes as damaged clouds and holds layers against the mesh."};
  options.add_option("MESH", setup.meshes, "closed meshes (PLY, OFF, STL)")->required();
  options.add_option("--damage", setup.damages, "whole,holes3,holes5,off3,off10,noise1,noise2,density10,two,all")
      ->delimiter(',');
  options.add_option("--seeds", setup.seeds)->delimiter(',');
  options.add_flag("!--off", setup.complete, "slice without closing gaps");
  options.add_flag("--reasons", setup.reasons, "also list flagged layers");
  options.add_flag("--verdicts", setup.verdicts, "also count, by reason, flagged layers that are right and wrong");
  options.add_option("--save", setup.save, "folder for the damaged clouds");
  options.add_flag("--poisson", setup.poisson,
                   "beside each row that of Poisson reconstruction (PCL, depth 8, weight 4)");
  options.add_option("--every", setup.judged, "every so many-th layer is held against the mesh");
  options.add_flag("--list", setup.list, "also list every layer held against the mesh");
  options.add_flag("--wrong", setup.wrong, "also list layers that are certified and wrong");
  options.add_option("--draw", setup.draw, "folder for pictures (SVG) of layers that are certified and wrong");
  options.add_option("--against", setup.against,
                     "folder of meshes that another program made of the clouds of --save, under the same names");
  CLI11_PARSE(options, argc, argv);
  return telefab::campaign::run(setup);
}
