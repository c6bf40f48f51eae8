// SPDX-License-Identifier: GPL-3.0-or-later
// Every scan of a folder, for several machines and in several orientations: sliced, planned, and the final masks and
// regions checked. Run by hand; a row of the table a plan. Slices are kept, so that a second run only plans.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <map>
#include <numbers>
#include <telefab/base/clock.hpp>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/fab/verify/print_files.hpp>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t kMaxBytes = 4ULL << 30U;

struct Setup {
  std::vector<fs::path> scans;
  std::vector<std::string> machines{"machine-a", "machine-b", "machine-c"};
  std::string profiles = "deploy/config/machines";
  fs::path keep = "campaign-slices";
  std::vector<int> turns{0, 1, 2, 3};
  std::uint32_t most_layers = 400;
  std::vector<std::string> only;
  bool regions = true;
  bool cuts = false;
};

/// Orientations: as it stands, on its side, on its face, and on no face at all.
Eigen::Matrix3d turn_of(int number) {
  using Axis = Eigen::AngleAxisd;
  const auto degrees = [](double d) { return d * std::numbers::pi / 180; };
  switch (number) {
    case 1:
      return Axis{degrees(90), Eigen::Vector3d::UnitX()}.toRotationMatrix();
    case 2:
      return Axis{degrees(90), Eigen::Vector3d::UnitY()}.toRotationMatrix();
    case 3:
      return (Axis{degrees(50), Eigen::Vector3d::UnitY()} * Axis{degrees(35), Eigen::Vector3d::UnitX()})
          .toRotationMatrix();
    default:
      return Eigen::Matrix3d::Identity();
  }
}

/// How many times too large the contours are for the platform, from its middle; 1 where they fit.
double overhang_of(const std::vector<Layer>& layers, const MachineProfile& machine) {
  const double x = machine.platform.width_mm / 2, y = machine.platform.depth_mm / 2;
  double over = 1;
  for (const Layer& layer : layers)
    for (const Contour& ring : layer.contours) {
      const Bounds2 b = ring.bounds();
      over = std::max({over, std::abs(b.min.x_mm - x) / x, std::abs(b.max.x_mm - x) / x, std::abs(b.min.y_mm - y) / y,
                       std::abs(b.max.y_mm - y) / y});
    }
  return over;
}

Result<LayerStack> sliced(const fs::path& scan, const MachineProfile& machine, int turn, const Setup& setup) {
  const fs::path kept =
      setup.keep / fmt::format("{}-{}-{}-{}.tfc", scan.stem().string(), machine.name, turn, setup.most_layers);
  std::error_code missing;
  if (fs::exists(kept, missing)) {
    const auto bytes = read_file(kept, kMaxBytes);
    if (!bytes) return tl::unexpected{bytes.error()};
    return read_tfc(*bytes);
  }
  const auto bytes = read_file(scan, kMaxBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto cloud = scan::read_cloud(*bytes, scan.filename().string(), {}, {});
  if (!cloud) return tl::unexpected{cloud.error()};
  const Eigen::Matrix3f r = turn_of(turn).cast<float>();
  cloud->origin.setZero();  // where the scanner stood is of no matter here
  for (auto& p : cloud->points) p = r * p;
  for (auto& n : cloud->normals) n = (r * n).normalized();
  Eigen::Vector3f low = cloud->points.front(), high = low;
  for (const auto& p : cloud->points) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const Eigen::Vector3d size = (high - low).cast<double>();
  const double lift = machine.supports.lift_off_mm + machine.supports.base_thickness_mm;
  const Eigen::Vector3d room{
      machine.platform.width_mm, machine.platform.depth_mm,
      std::min(machine.platform.z_travel_mm - 2 * lift, setup.most_layers * machine.layers.thickness_mm)};
  scan::SliceRequest request;
  request.machine = machine;
  request.placement.height_mm = room.cwiseQuotient(size).minCoeff() * size.z() * (1 - 1e-5);
  request.chord_mm = CodecOptions{}.chord_error_pitch * machine.projection.pixel_pitch_mm;
  std::vector<Layer> layers;
  std::optional<StackHeader> header;
  const auto take = [&](const StackHeader& h, Layer&& layer) -> Result<void> {
    header = h;
    layers.push_back(std::move(layer));
    return {};
  };
  const auto ply = scan::write_ply(*cloud, {}, "turned");
  // An open scan's surface may reach beyond its points: then smaller, until it fits.
  for (int attempt = 0; attempt < 4; ++attempt) {
    layers.clear();
    const auto report = scan::slice_scan(ply, scan.stem().string() + ".ply", request, take, {}, {});
    if (!report) return tl::unexpected{report.error()};
    const double over = overhang_of(layers, machine);
    if (over <= 1) break;
    *request.placement.height_mm /= over * 1.01;
  }
  auto stack = LayerStack::from_layers(*header, std::move(layers));
  if (!stack) return tl::unexpected{stack.error()};
  const auto coded = write_tfc(*stack, {});
  if (!coded) return tl::unexpected{coded.error()};
  fs::create_directories(setup.keep);
  if (auto ok = write_file_atomically(kept, *coded); !ok) return tl::unexpected{ok.error()};
  return read_tfc(*coded);
}

struct Cuts {
  std::size_t cutting = 0;  ///< pins and struts that cut the part where they should keep their distance
  double most_px = 0;       ///< largest overlap of one of them with one layer
  std::string where;
};

/// Pins and struts against the part: what Structure says, cut layer by layer, without the arms, tips and feet that may
/// touch it.
Result<Cuts> cuts_of(const LayerStack& stack, const MachineProfile& machine) {
  const auto plan = fab::plan_supports(stack.layers(), stack.header(), machine, {}, {}, {});
  if (!plan) return tl::unexpected{plan.error()};
  const double t = stack.header().layer_thickness_mm, pixel = machine.projection.pixel_pitch_mm;
  std::vector<std::optional<fab::Region>> part(stack.layers().size());
  Cuts cuts;
  for (const fab::SupportElement& s : plan->structure().elements) {
    if (s.kind != fab::SupportElementKind::Pin && s.kind != fab::SupportElementKind::Brace) continue;
    double worst = 0;
    for (std::size_t k = 0; k < part.size(); ++k) {
      const double z = (static_cast<double>(k + plan->elevation_layers()) + 0.5) * t;
      if (z < s.bottom.z_mm || z >= s.top.z_mm) continue;
      if (!part[k]) {
        auto region = fab::Region::from_contours(stack.layers()[k].contours);
        if (!region) return tl::unexpected{region.error()};
        part[k] = std::move(*region);
      }
      const double at = (z - s.bottom.z_mm) / (s.top.z_mm - s.bottom.z_mm);
      const auto mix = [at](double a, double b) { return a + at * (b - a); };
      const fab::Region disc =
          fab::disc({mix(s.bottom.x_mm, s.top.x_mm), mix(s.bottom.y_mm, s.top.y_mm)},
                    Millimetres{mix(s.bottom_radius_mm, s.top_radius_mm)}, Millimetres{pixel / 10});
      const double overlap = fab::intersect(disc, *part[k]).area_mm2() / pixel / pixel;
      if (overlap <= worst) continue;
      worst = overlap;
      if (worst > cuts.most_px)
        cuts.where = fmt::format("{} r {:.2f}..{:.2f} mm, layer {} at ({:.3f}, {:.3f})", fab::name_of(s.kind),
                                 s.bottom_radius_mm, s.top_radius_mm, k, mix(s.bottom.x_mm, s.top.x_mm),
                                 mix(s.bottom.y_mm, s.top.y_mm));
      cuts.most_px = std::max(cuts.most_px, worst);
    }
    cuts.cutting += worst >= 2;  // specks below two pixels are no part to the planner
  }
  return cuts;
}

/// One row; the number of findings that hold the job.
Result<std::size_t> row(const fs::path& scan, const MachineProfile& machine, int turn, const Setup& setup) {
  const auto stack = sliced(scan, machine, turn, setup);
  if (!stack) return tl::unexpected{stack.error()};
  const fab::PlanSink drop = [](const fab::PlannedImage&) -> Result<void> { return {}; };
  const SystemClock clock;
  const auto plan = fab::plan_job(*stack, machine, {}, drop, clock, {}, {});
  if (!plan) return tl::unexpected{plan.error()};
  std::size_t wrong = 0;
  std::string regions = "-";
  std::vector<fab::Finding> findings(plan->check.findings);
  using Kind = fab::Finding::Kind;
  if (setup.regions) {
    const auto supports = fab::WrittenSupports::from_json(plan->supports_json);
    if (!supports) return tl::unexpected{supports.error()};
    fab::PrintGeometry print;
    print.part = stack->layers();
    print.elevation_layers = supports->elevation_layers();
    print.anchors = supports->anchors();
    print.support = [&](LayerIndex k) { return supports->section(k, stack->header().layer_thickness_mm); };
    const auto checked = fab::check_supports(print, machine, {}, {});
    if (!checked) return tl::unexpected{checked.error()};
    regions = fmt::format("{}/{}/{}/{}", checked->count(Kind::Island), checked->count(Kind::OutOfReach),
                          checked->count(Kind::FreePin), checked->count(Kind::TrappedSupport));
    for (const fab::Finding& f : checked->findings)
      if (fab::holds_the_job(f.kind)) findings.push_back(f), ++wrong;
  }
  const auto& f = plan->figures;
  wrong += plan->check.count(Kind::Island);
  fmt::print("{:24} {} {} {:5} {:5} {:4} {:4} {:4} {:6} {:>10} {:4} {:4} {:6.1f} {:6.2f} {:6.2f}\n",
             scan.stem().string(), machine.name.back(), turn, plan->part_layers, plan->anchors.size(), f.feet_on_part,
             f.thin_pins, f.braces, plan->check.count(Kind::Island), regions, plan->check.count(Kind::SuctionCup),
             plan->check.count(Kind::ResinTrap), 100 * f.support_mm3 / std::max(1e-9, f.part_mm3),
             plan->support_seconds, plan->mask_seconds);
  if (setup.cuts) {
    const auto cuts = cuts_of(*stack, machine);
    if (!cuts) return tl::unexpected{cuts.error()};
    if (cuts->cutting > 0)
      fmt::print("    {} pins and struts cut the part, by {:.1f} px at most: {}\n", cuts->cutting, cuts->most_px,
                 cuts->where);
    wrong += cuts->cutting;
  }
  int shown = 0;
  for (const fab::Finding& found : findings)
    if (fab::holds_the_job(found.kind) && ++shown <= 6)
      fmt::print("    {} layer {} at ({:.3f}, {:.3f}) {:.5f} mm2 = {:.1f} px\n", fab::name_of(found.kind),
                 found.layer.count(), found.place.x_mm, found.place.y_mm, found.size_mm2,
                 found.size_mm2 / machine.projection.pixel_pitch_mm / machine.projection.pixel_pitch_mm);
  std::fflush(stdout);
  return wrong;
}

int run(const Setup& setup) {
  const auto profiles = load_profiles(setup.profiles).map([](const auto& known) { return known.machines(); });
  if (!profiles) {
    fmt::print(stderr, "{}\n", profiles.error().what);
    return 1;
  }
  fmt::print("regions: islands/out of reach/free pins/trapped; share: supports' volume in % of the part's\n");
  fmt::print("{:24} m t {:>5} {:>5} {:>4} {:>4} {:>4} {:>6} {:>10} {:>4} {:>4} {:>6} {:>6} {:>6}\n", "scan", "layer",
             "anch", "feet", "need", "brac", "isle", "regions", "cup", "trap", "share", "sup_s", "mask_s");
  std::size_t rows = 0, wrong = 0, refused = 0;
  for (const int turn : setup.turns)
    for (const std::string& name : setup.machines)
      for (const fs::path& scan : setup.scans) {
        const auto machine = find_machine(*profiles, name);
        if (!machine) {
          fmt::print(stderr, "{}\n", machine.error().what);
          return 1;
        }
        const auto done = row(scan, *machine, turn, setup);
        ++rows;
        if (done) {
          wrong += *done;
        } else {
          ++refused;
          fmt::print("{:24} {} {} not planned: {}\n", scan.stem().string(), name.back(), turn, done.error().what);
        }
      }
  fmt::print("{} rows, {} refused, {} findings that hold a job\n", rows, refused, wrong);
  return wrong == 0 ? 0 : 8;
}

constexpr const char* kUsage =
    "campaign_supports FOLDER.. [--keep FOLDER] [--profiles FOLDER] [--machines a,b] [--turns 0,1,2,3]\n"
    "                  [--most-layers 400] [--only part-of-a-name] [--no-regions] [--cuts]\n";

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts(1);
  for (const char c : text)
    if (c == ',')
      parts.emplace_back();
    else
      parts.back() += c;
  return parts;
}

}  // namespace
}  // namespace telefab

int main(int argc, char** argv) {
  using namespace telefab;
  Setup setup;
  std::vector<std::string> folders;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--no-regions") {
      setup.regions = false;
      continue;
    }
    if (word == "--cuts") {
      setup.cuts = true;
      continue;
    }
    if (!word.starts_with("--")) {
      folders.push_back(word);
      continue;
    }
    if (++i == argc) {
      fmt::print(stderr, "{}", kUsage);
      return 1;
    }
    const std::string value = argv[i];
    const auto number = [](const std::string& text) {
      int n = 0;
      std::from_chars(text.data(), text.data() + text.size(), n);
      return n;
    };
    if (word == "--keep")
      setup.keep = value;
    else if (word == "--profiles")
      setup.profiles = value;
    else if (word == "--machines")
      setup.machines = split(value);
    else if (word == "--turns") {
      setup.turns.clear();
      for (const std::string& turn : split(value)) setup.turns.push_back(number(turn));
    } else if (word == "--most-layers")
      setup.most_layers = static_cast<std::uint32_t>(std::max(1, number(value)));
    else if (word == "--only")
      setup.only = split(value);
    else {
      fmt::print(stderr, "{}", kUsage);
      return 1;
    }
  }
  for (const std::string& folder : folders)
    for (const auto& entry : fs::recursive_directory_iterator{folder}) {
      if (!entry.is_regular_file() || entry.path().extension() == ".md" || entry.path().extension() == ".conf")
        continue;
      const std::string name = entry.path().stem().string();
      if (!setup.only.empty() && std::none_of(setup.only.begin(), setup.only.end(), [&](const std::string& part) {
            return name.find(part) != std::string::npos;
          }))
        continue;
      setup.scans.push_back(entry.path());
    }
  std::sort(setup.scans.begin(), setup.scans.end());
  if (setup.scans.empty()) {
    fmt::print(stderr, "{}no scan found\n", kUsage);
    return 1;
  }
  return run(setup);
}
