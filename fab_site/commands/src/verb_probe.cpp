// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <memory>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/screen/guarded_display.hpp>
#include <telefab/fab/screen/packing.hpp>

#include "verbs.hpp"

namespace telefab::fab {

namespace {

void print_projector(const Dlpc900Projector& projector) {
  const Dlpc900Identity& id = projector.identity();
  write_output(fmt::format("projector: {}\n{}", projector.facts().name, projector.describe()));
  write_output(fmt::format("  mirrors {} x {}{}, shortest exposure {} us\n", id.dmd.size.width_px,
                           id.dmd.size.height_px, id.dmd.two_controllers ? " behind two controllers" : "",
                           id.dmd.shortest_exposure_us));
  write_output(fmt::format("  hardware status {:#04x}, system status {:#04x}, main status {:#04x}: self-test passed\n",
                           id.hardware_status, id.system_status, id.main_status));
  write_output(fmt::format("  firmware rule: {}\n", dlpc900::firmware_facts(id.major, id.minor).note));
  write_output(fmt::format("  upload {:.1f} kB/s, measured with the LEDs hard off\n",
                           projector.facts().upload_bytes_per_s / 1000));
}

/// True: it answers.
bool probe_projector(const MachineProfile& machine, Clock& clock) {
  if (machine.devices.projector == ProjectorKind::Virtual) {
    write_output("projector: virtual\n");
    return true;
  }
  if (machine.devices.projector == ProjectorKind::Screen) {
    const auto screen = open_screen(machine, clock);
    if (screen) {
      write_output(
          fmt::format("projector: {}\n  black, and its guard darkens it where this program hangs: self-test passed\n",
                      (*screen)->facts().name));
      return true;
    }
    write_output(fmt::format("projector: {}\n{}", screen.error().what, describe_screens()));
    return false;
  }
  const auto projector = open_projector(machine, clock);
  if (projector)
    print_projector(**projector);
  else
    write_output(fmt::format("projector: {}\n", projector.error().what));
  return projector.has_value();
}

}  // namespace

VerbBody declare_probe(VerbOptions& options) {
  struct Options {
    MachineChoice machine;
    bool home = false;
  };
  auto o = std::make_shared<Options>();
  declare_machine_choice(options, o->machine, "profile that names the devices", MachineIs::Required);
  options.flag("--home", o->home, "also home the stage: it MOVES, upwards");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    const auto machine = chosen_machine(o->machine);
    if (!machine) return tl::unexpected{machine.error()};
    const auto clock = make_clock(*machine);
    int silent = 0;
    if (!probe_projector(*machine, *clock)) ++silent;
    if (machine->devices.stage == StageKind::Virtual) {
      write_output("stage: virtual\n");
    } else if (auto stage = open_stage(*machine, *clock)) {
      write_output(fmt::format("stage: {}, travel {} to {} mm\n", (*stage)->facts().name, (*stage)->facts().lowest_mm,
                               (*stage)->facts().highest_mm));
      if (machine->devices.light == LightSwitch::Stage)
        write_output(fmt::format("  {}, off; exposures in steps of {} ms\n", (*stage)->light_facts().name,
                                 (*stage)->light_facts().exposure_step.count() / 1000));
      if (o->home) {
        if (const auto ok = (*stage)->home(); !ok) return tl::unexpected{ok.error()};
        while (true) {
          const auto status = (*stage)->poll();
          if (!status) return tl::unexpected{status.error()};
          if (!status->moving) break;
          if (stop.stop_requested()) {
            (void)(*stage)->hold();
            return fail(ErrorCode::Cancelled, "stopped while homing; held");
          }
          clock->sleep_for(std::chrono::milliseconds{20});
        }
        write_output("  homed\n");
      }
    } else {
      write_output(fmt::format("stage: {}\n", stage.error().what));
      ++silent;
    }
    if (const auto ready = check_devices(*machine); !ready)
      write_output(fmt::format("not yet to be printed with: {}\n", ready.error().what));
    return silent == 0 ? ExitCode::Ok : ExitCode::Device;
  };
}

}  // namespace telefab::fab
