// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/device/sensors.hpp>
#include <telefab/fab/device/z_stage.hpp>
#include <telefab/fab/drivers/dlpc900_projector.hpp>
#include <telefab/fab/drivers/grbl_stage.hpp>
#include <telefab/fab/screen/screen_projector.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// The machine's two devices as its profile names them.
struct Devices {
  std::unique_ptr<MachineLog> log;  ///< what virtual devices did; real ones write nothing into it
  std::unique_ptr<ZStage> stage;
  std::unique_ptr<Projector> projector;  ///< ends before the stage, whose board may switch its light
  std::unique_ptr<Sensors> sensors;      ///< null where the machine feels nothing
};

/// Both devices are virtual: time may run faster than it does.
[[nodiscard]] bool is_simulated(const MachineProfile& machine);

/// The clock a machine's print runs on: sped up by devices.speed_up where both devices are virtual, else the system's.
[[nodiscard]] std::unique_ptr<Clock> make_clock(const MachineProfile& machine);

/// Opens the devices of the profile, virtual or real; real ones are dark when this returns. The clock must outlive
/// them. Fails: DeviceLost (not found; the message says what to look at), DeviceRefused (self-test), InvalidInput
/// (also: a whole printer, whose devices are its own; a projector whose led_polarity is not stated or whose led_current
/// is 0, one whose light nothing but this computer darkens, a thermometer or a light on a board that has none,
/// exposures that a board cannot time).
[[nodiscard]] Result<Devices> make_devices(const MachineProfile& machine, Clock& clock);

/// The light of a machine off, and its screen black; nothing to do for a virtual one. Where the stage's board switches
/// the light it restarts, and forgets its place. Fails as make_devices.
[[nodiscard]] Result<void> darken(const MachineProfile& machine, Clock& clock);

/// What keeps the profile's devices from printing; make_devices() asks this first.
[[nodiscard]] Result<void> check_devices(const MachineProfile& machine);

/// The real devices alone, for `telefab-fab probe`: as make_devices(), whatever the profile calls virtual.
[[nodiscard]] Result<std::unique_ptr<Dlpc900Projector>> open_projector(const MachineProfile& machine, Clock& clock);
[[nodiscard]] Result<std::unique_ptr<ScreenProjector>> open_screen(const MachineProfile& machine, Clock& clock);
[[nodiscard]] Result<std::unique_ptr<SerialStage>> open_stage(const MachineProfile& machine, Clock& clock);

/// The resin's thermometer of a Marlin board. The stage must outlive it.
[[nodiscard]] std::unique_ptr<Sensors> thermometer_of(SerialStage& stage);

/// Largest gap the stage can make: the tallest part and one peel above it.
[[nodiscard]] double stage_top_mm(const MachineProfile& machine);

}  // namespace telefab::fab
