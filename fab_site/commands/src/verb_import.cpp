// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/formats/contour_import.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMostBytes = 2ULL << 30U;

struct Options {
  std::string from;
  std::string out;
  MachineChoice machine;
  std::string units;
  std::string place = "keep";
};

/// A contour file is proved to be whole and to fit the machine, and copied as it is.
Result<std::uint32_t> copy_tfc(std::span<const std::byte> bytes, const MachineProfile& machine, const Options& o) {
  const auto stack = read_tfc(bytes);
  if (!stack) return fail_in(o.from, stack.error());
  const double thickness_mm = stack->header().layer_thickness_mm;
  if (std::abs(thickness_mm - machine.layers.thickness_mm) > 1e-9 * thickness_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: the layers are {} mm thick; {} exposes layers of {} mm. Slice it for this machine",
                            o.from, thickness_mm, machine.name, machine.layers.thickness_mm));
  const Bounds2 b = stack->header().bounds;
  if (b.max.x_mm > machine.platform.width_mm || b.max.y_mm > machine.platform.depth_mm || b.min.x_mm < 0 ||
      b.min.y_mm < 0)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: its contours reach to ({:.2f}, {:.2f}) mm; the platform of {} is {} x {} mm. Slice it "
                            "for this machine",
                            o.from, b.max.x_mm, b.max.y_mm, machine.name, machine.platform.width_mm,
                            machine.platform.depth_mm));
  if (auto ok = write_file_atomically(o.out, bytes); !ok) return tl::unexpected{ok.error()};
  return stack->header().layer_count;
}

void print_report(const ImportReport& r) {
  write_output(fmt::format("{}: {} rings with {} vertices\n", name_of(r.format), r.rings, r.vertices));
  if (r.heights_in_millionths)
    write_output("the heights of the file (slic3r:z) are millionths of millimetres and were multiplied\n");
  if (std::abs(r.lowered_mm) > 1e-3)
    write_output(fmt::format("the lowest layer began at {:.3f} mm and lies on the platform now\n", r.lowered_mm));
  if (r.turned_rings != 0)
    write_output(fmt::format("{} rings ran against their nesting and were turned\n", r.turned_rings));
  if (r.dropped_rings != 0)
    write_output(fmt::format("{} rings of fewer than three places were left out\n", r.dropped_rings));
  if (r.rebuilt_layers != 0)
    write_output(fmt::format("in {} layers rings or parts touched and were united\n", r.rebuilt_layers));
  if (r.skipped_hatches != 0) write_output(fmt::format("{} hatch lines were left out\n", r.skipped_hatches));
}

Result<ExitCode> run(const Options& o, const std::stop_token& stop) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto bytes = read_file(o.from, kMostBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  if (is_tfc(*bytes)) {
    const auto layers = copy_tfc(*bytes, *machine, o);
    if (!layers) return tl::unexpected{layers.error()};
    write_output(fmt::format("{} layers, whole and fit for {}; copied to {}\n", *layers, machine->name, o.out));
    return ExitCode::Ok;
  }
  ImportOptions options;
  options.name = std::filesystem::path{o.from}.filename().string();
  options.centre = o.place == "centre";
  if (!o.units.empty()) options.unit_mm = o.units == "mm" ? 1 : o.units == "um" ? 0.001 : o.units == "cm" ? 10 : 25.4;
  const auto import = import_contours(*bytes, *machine, options, progress_line(), stop);
  clear_progress();
  if (!import) return fail_in(o.from, import.error());
  const auto tfc = write_tfc(import->stack, CodecOptions{.coding = Coding::Exact});
  if (!tfc) return fail_in(o.from, tfc.error());
  if (auto ok = write_file_atomically(o.out, *tfc); !ok) return tl::unexpected{ok.error()};
  print_report(import->report);
  write_output(fmt::format("{} layers written to {}; plan them with: telefab-fab plan {} --out DIR\n",
                           import->stack.header().layer_count, o.out, o.out));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_import(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options
      .add("FILE", o->from,
           "contours: Common Layer Interface (text or binary), SVG with slic3r:z, 3MF with slices, JSON lines, or "
           ".tfc; told apart by their first bytes")
      .required();
  options.add_output("--out", o->out, "contour file to write (.tfc)").required();
  declare_machine_choice(options, o->machine, "machine the layers were cut for: their thickness must be its own",
                         MachineIs::Required);
  options.add("--units", o->units, "unit of the coordinates where the file does not say it: mm, um, cm or inch")
      .one_of({"mm", "um", "cm", "inch"});
  options
      .add("--place", o->place,
           "keep: where the file has it, from the front left corner of the platform; centre: in its middle")
      .one_of({"keep", "centre"})
      .shows_default();
  options.footer(
      "What an odd number of rings surrounds is solid, whichever way they run. Rings that cross are refused with "
      "layer\n"
      "and place. Layers must be as thick as the machine's, none missing; the lowest is put on the platform. Vertices\n"
      "move by at most 1/22 of a pixel.");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::fab
