// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <string_view>
#include <telefab/fab/cure/calibration.hpp>

// Any file of measurements is refused or gives figures that a profile takes.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  const auto rows = telefab::fab::measured_from_csv({reinterpret_cast<const char*>(bytes), size});
  if (!rows || rows->size() > 200) return 0;
  const auto calibration = telefab::fab::fit_calibration(*rows, 10);
  if (!calibration) return 0;
  telefab::MachineProfile machine;
  machine.name = "fuzzed";
  machine.platform = {100, 100, 100};
  machine.projection.pixel_pitch_mm = 0.1;
  machine.projection.irradiance_mw_per_cm2 = 10;
  machine.layers = {0.1, 1, 0, 1};
  const auto profile = telefab::fab::calibrated(machine, *calibration);
  if (!telefab::machine_profile_from_toml(telefab::to_toml(profile), "fuzzed")) __builtin_trap();
  (void)telefab::fab::to_toml_fragment(*calibration);
  return 0;
}
