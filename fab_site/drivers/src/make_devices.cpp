#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/drivers/make_devices.hpp>

namespace telefab::fab {

namespace {

bool all_virtual(const MachineProfile& m) { return m.devices.projector == "virtual" && m.devices.stage == "virtual"; }

}  // namespace

std::unique_ptr<Clock> make_clock(const MachineProfile& machine) {
  if (all_virtual(machine) && machine.devices.speed_up != 1)
    return std::make_unique<ScaledClock>(machine.devices.speed_up);
  return std::make_unique<SystemClock>();
}

double stage_top_mm(const MachineProfile& machine) { return machine.platform.z_travel_mm + machine.motion.lift_mm; }

Result<Devices> make_devices(const MachineProfile& machine, Clock& clock) {
  if (!all_virtual(machine))
    return fail(ErrorCode::InvalidInput, "machine " + machine.name + ": only virtual devices are built in");
  Devices devices;
  devices.log = std::make_unique<MachineLog>();
  devices.projector = std::make_unique<VirtualProjector>(machine.mask_size(), 0, clock, *devices.log);
  devices.stage = std::make_unique<VirtualZStage>(stage_top_mm(machine), clock, *devices.log);
  return devices;
}

}  // namespace telefab::fab
