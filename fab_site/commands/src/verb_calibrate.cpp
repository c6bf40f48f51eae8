// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/cure/calibration.hpp>
#include <telefab/fab/cure/size_calibration.hpp>
#include <telefab/image/png.hpp>

#include "verbs.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxMeasuredBytes = 64U << 20U;

struct CalibrateVerb {
  std::string part, measured, out;
  MachineChoice machine;
  double irradiance_mw_per_cm2 = 0;
};

/// A folder that holds nothing measured yet.
Result<fs::path> begun_folder(const CalibrateVerb& o) {
  if (o.out.empty()) return fail(ErrorCode::InvalidInput, "name a folder with --out");
  fs::path folder{o.out};
  std::error_code error;
  if (fs::exists(folder / "measured.csv", error))
    return fail(ErrorCode::Conflict,
                fmt::format("{} may hold measurements; name another folder", (folder / "measured.csv").string()));
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::NotPermitted, fmt::format("cannot make the folder {}: {}", o.out, error.message()));
  return folder;
}

/// What is to be measured, and how, behind all that is to be shown or printed.
Result<void> write_questions(const fs::path& folder, const std::string& readme, const std::string& measured_csv) {
  if (auto ok = write_file_atomically(folder / "README.md", readme); !ok) return ok;
  return write_file_atomically(folder / "measured.csv", measured_csv);
}

Result<std::string> measured_text(const CalibrateVerb& o) {
  const auto bytes = read_file(o.measured, kMaxMeasuredBytes);
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
  const auto folder = begun_folder(o);
  if (!folder) return tl::unexpected{folder.error()};
  if (auto ok = write_file_atomically(*folder / "size.tfc", *tfc); !ok) return tl::unexpected{ok.error()};
  if (auto ok = write_questions(*folder, artefact->readme, artefact->measured_csv); !ok)
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
  const auto text = measured_text(o);
  if (!text) return tl::unexpected{text.error()};
  const auto rows = sizes_from_csv(*text);
  if (!rows) return fail_in(o.measured, rows.error());
  const auto calibration = fit_sizes(*rows);
  if (!calibration) return fail_in(o.measured, calibration.error());
  return give(to_toml_fragment(*calibration), o);
}

Result<ExitCode> write_masks(const CalibrateVerb& o, std::stop_token stop) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto tests = calibration_masks(*machine);
  if (!tests) return tl::unexpected{tests.error()};
  const auto begun = begun_folder(o);
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
  if (auto ok = write_questions(folder, tests->readme, tests->measured_csv); !ok) return tl::unexpected{ok.error()};
  write_output(fmt::format("{} masks in {}; read its README.md for what to measure\n", tests->masks.size(), o.out));
  return ExitCode::Ok;
}

Result<ExitCode> fit(const CalibrateVerb& o) {
  if (o.measured.empty()) return fail(ErrorCode::InvalidInput, "name the file of measurements, e.g. measured.csv");
  const auto text = measured_text(o);
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
           "printed and measured or, with MEASURED, fit what it shrank")
      .required()
      .one_of({"masks", "fit", "size"});
  options.add("MEASURED", o->measured, "fit, size: the filled-in measured.csv");
  declare_machine_choice(options, o->machine,
                         "machine profile; masks: for its pixels and exposure; size: for its platform; fit: its "
                         "irradiance, where none was measured",
                         MachineIs::Optional);
  options.add("--irradiance", o->irradiance_mw_per_cm2, "fit: mW/cm2 of a white area, where none was measured")
      .within(0.01, 1000.0);
  options.add("--out", o->out, "masks, size: folder; with measurements: file for the sections of the profile (TOML)");
  options.footer(
      "measured.csv has the columns test, grey, row, column, period_px, exposure_s, value, unit; `calibrate masks` "
      "writes\n"
      "it with a row for everything to measure. That of `calibrate size` has the columns test, drawn_mm, value, unit.");
  return [o](std::stop_token stop) {
    if (o->part == "size") return o->measured.empty() ? write_size(*o) : fit_size(*o);
    return o->part == "masks" ? write_masks(*o, stop) : fit(*o);
  };
}

}  // namespace telefab::fab
