// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/cure/calibration.hpp>
#include <telefab/fab/cure/size_calibration.hpp>
#include <telefab/fab/cure/support_calibration.hpp>
#include <telefab/image/png.hpp>

#include "verbs.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxMeasuredBytes = 64U << 20U;
constexpr std::string_view kMeasured = "measured.csv", kSupports = "supports.csv";

struct CalibrateVerb {
  std::string part, measured, read, out;
  MachineChoice machine;
  double irradiance_mw_per_cm2 = 0;
};

/// A folder that holds nothing measured yet: not the table that is to be filled in.
Result<fs::path> begun_folder(const CalibrateVerb& o, std::string_view table) {
  if (o.out.empty()) return fail(ErrorCode::InvalidInput, "name a folder with --out");
  fs::path folder{o.out};
  std::error_code error;
  if (fs::exists(folder / table, error))
    return fail(ErrorCode::Conflict,
                fmt::format("{} may hold measurements; name another folder", (folder / table).string()));
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::NotPermitted, fmt::format("cannot make the folder {}: {}", o.out, error.message()));
  return folder;
}

/// What is to be measured, and how, behind all that is to be shown or printed.
Result<void> write_questions(const fs::path& folder, const std::string& readme, std::string_view table,
                             const std::string& csv) {
  if (auto ok = write_file_atomically(folder / "README.md", readme); !ok) return ok;
  return write_file_atomically(folder / table, csv);
}

Result<std::string> measured_text(const std::string& path) {
  const auto bytes = read_file(path, kMaxMeasuredBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  return std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

Result<ExitCode> give(const std::string& fragment, const CalibrateVerb& o) {
  write_output(fragment);
  if (!o.out.empty())
    if (auto ok = write_file_atomically(o.out, fragment); !ok) return tl::unexpected{ok.error()};
  return ExitCode::Ok;
}

Result<ExitCode> write_size(const CalibrateVerb& o) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto artefact = size_artefact(*machine);
  if (!artefact) return tl::unexpected{artefact.error()};
  const auto tfc = write_tfc(artefact->stack, CodecOptions{.coding = Coding::Exact});
  if (!tfc) return tl::unexpected{tfc.error()};
  const auto folder = begun_folder(o, kMeasured);
  if (!folder) return tl::unexpected{folder.error()};
  if (auto ok = write_file_atomically(*folder / "size.tfc", *tfc); !ok) return tl::unexpected{ok.error()};
  if (auto ok = write_questions(*folder, artefact->readme, kMeasured, artefact->measured_csv); !ok)
    return tl::unexpected{ok.error()};
  const Bounds2 b = artefact->stack.header().bounds;
  write_output(
      fmt::format("a body of {:.2f} x {:.2f} x {:.2f} mm in {}; read its README.md for how to print and what to "
                  "measure\n",
                  b.width_mm(), b.depth_mm(),
                  artefact->stack.header().layer_count * artefact->stack.header().layer_thickness_mm, o.out));
  return ExitCode::Ok;
}

Result<ExitCode> fit_size(const CalibrateVerb& o) {
  const auto text = measured_text(o.measured);
  if (!text) return tl::unexpected{text.error()};
  const auto rows = sizes_from_csv(*text);
  if (!rows) return fail_in(o.measured, rows.error());
  const auto calibration = fit_sizes(*rows);
  if (!calibration) return fail_in(o.measured, calibration.error());
  return give(to_toml_fragment(*calibration), o);
}

Result<ExitCode> write_supports(const CalibrateVerb& o) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto print = support_print(*machine);
  if (!print) return tl::unexpected{print.error()};
  const auto tfc = write_tfc(print->stack, CodecOptions{.coding = Coding::Exact});
  if (!tfc) return tl::unexpected{tfc.error()};
  const auto map = encode_png(print->map);
  if (!map) return tl::unexpected{map.error()};
  const auto folder = begun_folder(o, kSupports);
  if (!folder) return tl::unexpected{folder.error()};
  if (auto ok = write_file_atomically(*folder / "supports.tfc", *tfc); !ok) return tl::unexpected{ok.error()};
  if (auto ok = write_file_atomically(*folder / "map.png", *map); !ok) return tl::unexpected{ok.error()};
  if (auto ok = write_questions(*folder, print->readme, kSupports, print->supports_csv); !ok)
    return tl::unexpected{ok.error()};
  write_output(
      fmt::format("{} discs of {:.2f} mm and shelves on a block of {:.0f} mm2, {:.2f} mm high, in {}; read its "
                  "README.md for how to "
                  "print and what to look at\n",
                  std::count_if(print->specimens.begin(), print->specimens.end(),
                                [](const SupportSpecimen& s) { return s.kind != SupportSpecimen::Kind::Shelf; }),
                  print->disc_mm, print->block_mm2,
                  print->stack.header().layer_count * print->stack.header().layer_thickness_mm, o.out));
  return ExitCode::Ok;
}

Result<ExitCode> fit_held(const CalibrateVerb& o) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto text = measured_text(o.read);
  if (!text) return tl::unexpected{text.error()};
  const auto readings = support_readings_from_csv(*text, *machine);
  if (!readings) return fail_in(o.read, readings.error());
  const auto calibration = fit_supports(*readings, machine->layers.thickness_mm);
  if (!calibration) return fail_in(o.read, calibration.error());
  return give(to_toml_fragment(*calibration, *machine), o);
}

/// Which of a verb's options belong to which part; InvalidInput where one is stated for another.
Result<void> check(const CalibrateVerb& o) {
  const bool supports = o.part == "supports";
  if (supports && !o.measured.empty())
    return fail(ErrorCode::InvalidInput,
                fmt::format("calibrate supports reads what held by an option: --read {}", o.measured));
  if (!supports && !o.read.empty())
    return fail(ErrorCode::InvalidInput, "--read is for supports; name the file of measurements without it");
  if (supports && o.machine.name.empty())
    return fail(ErrorCode::InvalidInput, "name the machine with --machine: the print is made for it, and read by it");
  return {};
}

Result<ExitCode> write_masks(const CalibrateVerb& o, std::stop_token stop) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto tests = calibration_masks(*machine);
  if (!tests) return tl::unexpected{tests.error()};
  const auto begun = begun_folder(o, kMeasured);
  if (!begun) return tl::unexpected{begun.error()};
  const fs::path& folder = *begun;
  for (const TestMask& test : tests->masks) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "calibrate was cancelled; the folder is not complete");
    const auto png = encode_png_grey(test.mask.size.width_px, test.mask.size.height_px, test.mask.rows);
    if (!png) return tl::unexpected{png.error()};
    if (auto ok = write_file_atomically(folder / test.file, *png); !ok) return tl::unexpected{ok.error()};
  }
  if (auto ok = write_file_atomically(folder / "exposures.json", exposures_json(*tests, *machine)); !ok)
    return tl::unexpected{ok.error()};
  if (auto ok = write_questions(folder, tests->readme, kMeasured, tests->measured_csv); !ok)
    return tl::unexpected{ok.error()};
  write_output(fmt::format("{} masks in {}; read its README.md for what to measure\n", tests->masks.size(), o.out));
  return ExitCode::Ok;
}

Result<ExitCode> fit(const CalibrateVerb& o) {
  if (o.measured.empty()) return fail(ErrorCode::InvalidInput, "name the file of measurements, e.g. measured.csv");
  const auto text = measured_text(o.measured);
  if (!text) return tl::unexpected{text.error()};
  const auto rows = measured_from_csv(*text);
  if (!rows) return fail_in(o.measured, rows.error());
  double irradiance = o.irradiance_mw_per_cm2;
  if (irradiance == 0 && !o.machine.name.empty()) {
    const auto machine = chosen_machine(o.machine);
    if (!machine) return tl::unexpected{machine.error()};
    irradiance = machine->projection.irradiance_mw_per_cm2;
  }
  const auto calibration = fit_calibration(*rows, irradiance);
  if (!calibration) return fail_in(o.measured, calibration.error());
  return give(to_toml_fragment(*calibration), o);
}

}  // namespace

VerbBody declare_calibrate(VerbOptions& options) {
  auto o = std::make_shared<CalibrateVerb>();
  options
      .add("WHAT", o->part,
           "masks: write test masks; fit: fit the profile's figures to measurements; size: write a body to be "
           "printed and measured or, with MEASURED, fit what it shrank; supports: write a print of which a part tears "
           "or, with --read, fit what held")
      .required()
      .one_of({"masks", "fit", "size", "supports"});
  options.add("MEASURED", o->measured, "fit, size: the filled-in measured.csv");
  declare_machine_choice(options, o->machine,
                         "machine profile; masks: for its pixels and exposure; size: for its platform; fit: its "
                         "irradiance, where none was measured; supports: for its pixels, layers and pull, needed",
                         MachineIs::Optional);
  options.add("--irradiance", o->irradiance_mw_per_cm2, "fit: mW/cm2 of a white area, where none was measured")
      .within(0.01, 1000.0);
  options.add("--read", o->read, "supports: the filled-in supports.csv");
  options.add_output("--out", o->out,
                     "masks, size, supports: folder; with measurements: file for the sections of the profile (TOML)");
  options.footer(
      "measured.csv has the columns test, grey, row, column, period_px, exposure_s, value, unit; `calibrate masks` "
      "writes\n"
      "it with a row for everything to measure. That of `calibrate size` has the columns test, drawn_mm, value, unit.\n"
      "\n"
      "`calibrate supports` writes supports.tfc (plan it with --supports none --masks cover), map.png and "
      "supports.csv\n"
      "with the columns machine, test, number, demand, overhang_mm, held. Discs on three necks bear 30 to 850 times\n"
      "the pull of the film: look which are whole, find their numbers on the map, write yes or no into the column\n"
      "held, and read it with the --machine, --resin and --print it was printed with. What comes out: the green\n"
      "strength for which a plan may ask for what held, by the profile's safety, the pull it goes with, and how far\n"
      "one layer may reach (supports.overhang_share), each with its interval of 95 %. Where all discs held the\n"
      "strength is a lower bound, and is named so. What tears stays on the film: empty the vat before the next print.");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto ok = check(*o); !ok) return tl::unexpected{ok.error()};
    if (o->part == "supports") return o->read.empty() ? write_supports(*o) : fit_held(*o);
    if (o->part == "size") return o->measured.empty() ? write_size(*o) : fit_size(*o);
    return o->part == "masks" ? write_masks(*o, stop) : fit(*o);
  };
}

}  // namespace telefab::fab
