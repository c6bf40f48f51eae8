// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/slice_options.hpp>
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/inspect/inspect_scan.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>

#include "verbs.hpp"

namespace telefab::scan {
namespace {

constexpr std::uint64_t kMaxScanBytes = 64ULL << 30U;
/// A scene has hundreds; nobody reads them.
constexpr std::size_t kMostListed = 8;

/// What decides where the scan stands and what its surface is; nothing is cut here.
constexpr std::array<std::string_view, 15> kPlacing{
    "height_mm", "scale", "fit",    "units",        "up",      "rotate",    "mirror",       "scale_axes",
    "position",  "crop",  "pieces", "sample_faces", "surface", "kernel_mm", "keep_outliers"};

struct Options {
  std::string cloud;
  MachineChoice machine;
  SliceParameters asked;
  std::string out_prefix;
  bool json = false;
};

void print_table(const Inspection& inspection, double noise_mm) {
  const HeightTopology& t = inspection.topology;
  const KernelChoice& k = inspection.kernel;
  write_output(fmt::format("{}: {} points, {:.2f} x {:.2f} x {:.2f} mm\n", inspection.scan_name, inspection.points,
                           inspection.size_mm.x(), inspection.size_mm.y(), inspection.size_mm.z()));
  if (const std::string placed = sentence_of(inspection.placement); !placed.empty())
    write_output(fmt::format("{}\n", placed));
  if (inspection.chosen) write_output(fmt::format("{}\n", sentence_of(*inspection.chosen)));
  write_output(fmt::format("kernel {:.3f} mm{}, spacing {:.3f} mm, noise {:.3f} mm, {} samples dropped, surface {}\n",
                           k.kernel_mm, k.adaptive ? " (median, by local spacing)" : "", k.spacing_mm, k.noise_mm,
                           k.dropped_samples, inspection.surface));

  for (const std::string& warning : inspection.warnings) write_output(fmt::format("warning: {}\n", warning));

  constexpr std::array kKinds{CriticalKind::Minimum, CriticalKind::BottomSaddle, CriticalKind::TopSaddle,
                              CriticalKind::Maximum};
  std::string counts;
  for (const CriticalKind kind : kKinds)
    counts += fmt::format("{}{} {}", counts.empty() ? "" : ", ",
                          std::count_if(t.critical_points().begin(), t.critical_points().end(),
                                        [&](const auto& c) { return c.kind == kind && !c.plateau; }),
                          name_of(kind));
  write_output(fmt::format("critical points: {}; {} plateaus\n\n", counts, t.plateaus().size()));
  write_output(fmt::format("{:>10} {:>10} {:>10}  {:<14} {:<6} {:>11} {:>12}\n", "z mm", "x mm", "y mm", "kind",
                           "normal", "lives mm", "Euler above"));
  const auto is_noise = [noise_mm](const CriticalPoint& c) { return c.persistence_mm < noise_mm; };
  const auto print_point = [&](const CriticalPoint& c) {
    const double above = c.position_mm.z() + 1e-9 * (1 + std::abs(c.position_mm.z()));
    const auto euler = t.predicted_euler(above);
    write_output(fmt::format("{:>10.4f} {:>10.4f} {:>10.4f}  {:<14} {:<6} {:>11} {:>12}\n", c.position_mm.z(),
                             c.position_mm.x(), c.position_mm.y(), name_of(c.kind), c.normal_up ? "up" : "down",
                             std::isfinite(c.persistence_mm) ? fmt::format("{:.4f}", c.persistence_mm) : "for good",
                             euler ? fmt::format("{}", *euler) : "?"));
  };
  std::vector<CriticalPoint> lasting, noise;
  for (const CriticalPoint& c : t.critical_points())
    if (!c.plateau) (is_noise(c) ? noise : lasting).push_back(c);
  std::ranges::for_each(lasting, print_point);
  if (!noise.empty())
    write_output(fmt::format("noise, {} that live over less than {:.4f} mm:\n", noise.size(), noise_mm));
  std::ranges::for_each(noise, print_point);
  for (const Plateau& p : t.plateaus())
    write_output(fmt::format("plateau from {:.4f} to {:.4f} mm near ({:.3f}, {:.3f}), {} critical points\n", p.low_mm,
                             p.high_mm, p.place_mm.x(), p.place_mm.y(), p.critical_points));
  write_output(fmt::format("\nEuler number {}{}, {} contour arcs between {} nodes\n", t.euler(),
                           t.euler_is_certain() ? "" : " (not certain: see the inconsistencies)", t.arcs().size(),
                           t.nodes().size()));
  for (std::size_t i = 0; i < t.components().size(); ++i) {
    const SurfaceComponent& c = t.components()[i];
    write_output(fmt::format("piece {}: {:.3f} to {:.3f} mm, Euler number {}, {}\n", i, c.low_mm, c.high_mm, c.euler,
                             c.genus ? fmt::format("genus {}", *c.genus) : "not certain: genus unknown"));
  }
  const auto wrong = t.inconsistencies();
  for (std::size_t i = 0; i < std::min(wrong.size(), kMostListed); ++i)
    write_output(fmt::format("inconsistent: {}\n", wrong[i]));
  if (wrong.size() > kMostListed)
    write_output(fmt::format("and {} inconsistencies more (--json lists them)\n", wrong.size() - kMostListed));
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  if (o.asked.fit && o.machine.name.empty())
    return fail(ErrorCode::InvalidInput, "--fit needs a --machine to fit into");
  if (o.asked.up && o.asked.up->starts_with("auto") && o.machine.name.empty())
    return fail(ErrorCode::InvalidInput, "--up auto needs the --machine whose supports are to be few");
  if (o.asked.position && o.machine.name.empty())
    return fail(ErrorCode::InvalidInput, "--position needs the platform of a --machine");
  std::optional<MachineProfile> machine;
  if (!o.machine.name.empty()) {
    auto chosen = chosen_machine(o.machine);
    if (!chosen) return tl::unexpected{chosen.error()};
    machine = std::move(*chosen);
  }
  const auto asked = job_parameters_of(o.asked, machine.value_or(MachineProfile{}), Contours::Plain);
  if (!asked) return tl::unexpected{asked.error()};
  const SliceRequest& slice = asked->slice;
  const InspectRequest request{slice.intake, machine, slice.placement, slice.mls};

  const auto scan = read_file(o.cloud, kMaxScanBytes);
  if (!scan) return tl::unexpected{scan.error()};
  const std::string name = std::filesystem::path{o.cloud}.filename().string();
  const auto inspection = inspect_scan(*scan, name, request, {}, stop);
  if (!inspection) return tl::unexpected{inspection.error()};

  if (o.json)
    write_output(fmt::format("{}\n", to_json(*inspection)));
  else
    print_table(*inspection, inspection->kernel.noise_mm);
  if (o.out_prefix.empty()) return ExitCode::Ok;

  const auto png = encode_png(draw_inspection(*inspection));
  if (!png) return tl::unexpected{png.error()};
  if (auto ok = write_file_atomically(o.out_prefix + ".png", *png); !ok) return tl::unexpected{ok.error()};
  if (auto ok = write_file_atomically(o.out_prefix + ".ply", to_ply(*inspection)); !ok)
    return tl::unexpected{ok.error()};
  if (auto ok = write_file_atomically(o.out_prefix + ".vtp", to_vtp(*inspection)); !ok)
    return tl::unexpected{ok.error()};
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_inspect(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("CLOUD", o->cloud, fmt::format("scan: {}", kReadableScans)).required();
  declare_machine_choice(options, o->machine, "place it as it would be sliced for this machine", MachineIs::Optional);
  declare_slice_parameters(options, o->asked, kPlacing, check_text);
  options.add_output("--out-prefix", o->out_prefix,
                     "write a picture PREFIX.png and PREFIX.ply, PREFIX.vtp for a viewer", {".png", ".ply", ".vtp"});
  options.flag("--json", o->json, "print everything as JSON");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
