// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/drivers/grbl_stage.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/usb/libusb_transport.hpp>
#include <telefab/fab/usb/tty_line.hpp>

namespace telefab::fab {

namespace {

constexpr std::uint16_t kTexasInstruments = 0x0451;
constexpr std::uint16_t kDlpc900 = 0xC900;

class StageThermometer final : public Sensors {
 public:
  explicit StageThermometer(SerialStage& stage) : stage_{stage} {}
  Result<SensorReading> read() override {
    const auto celsius = stage_.celsius();
    if (!celsius) return tl::unexpected{celsius.error()};
    return SensorReading{false, *celsius};
  }

 private:
  SerialStage& stage_;
};

/// What a print needs to be told about real devices.
Result<void> check_statements(const MachineProfile& machine) {
  const auto wrong = [&](std::string_view what) {
    return fail(ErrorCode::InvalidInput, "machine " + machine.name + ": " + std::string{what});
  };
  const auto& d = machine.devices;
  if (d.projector == ProjectorKind::Dlpc900 && d.led_polarity == LedPolarity::Unstated)
    return wrong(
        "state devices.led_polarity, normal or inverted, as the board's maker says (fab_site/drivers/first-light.md)");
  if (d.projector == ProjectorKind::Dlpc900 && d.led_current == 0)
    return wrong("devices.led_current is 0, nothing would cure; raise it as fab_site/drivers/first-light.md says");
  if (d.projector == ProjectorKind::Dlpc900 && d.led_off == LedOff::EnableAndCurrent && d.led_cutoff == LedCutoff::None)
    return wrong(
        "its LEDs glow until this computer sends a current of zero (devices.led_off), so nothing would darken them "
        "where "
        "this computer dies; put a watchdog before them and state devices.led_cutoff = \"watchdog\" "
        "(fab_site/drivers/first-light.md)");
  const auto& motion = machine.motion;
  if (d.stage != StageKind::Virtual && (motion.tilt_s > 0 || motion.large.tilt_s > 0 || motion.bottom.tilt_s > 0))
    return wrong(
        "motion.tilt_s, large_tilt_s and bottom_tilt_s are for archives and virtual stages; a stage by GRBL or "
        "Marlin tips no vat");
  if (d.projector == ProjectorKind::Dlpc900)
    for (const double share : {machine.layers.light_share, machine.light_share_of_layer(0)})
      if (const auto step = light_step(share, d.led_current); !step) return wrong(step.error().what);
  if (d.thermometer != Thermometer::None && d.stage != StageKind::Marlin)
    return wrong("devices.thermometer needs stage = \"marlin\"; GRBL boards and virtual stages have none");
  if ((d.hottest_celsius > 0 || d.coldest_celsius > 0) && d.thermometer == Thermometer::None)
    return wrong("temperature limits need devices.thermometer");
  if (d.hottest_celsius > 0 && d.hottest_celsius <= d.coldest_celsius)
    return wrong("devices.hottest_celsius is not above devices.coldest_celsius");
  return {};
}

}  // namespace

bool is_simulated(const MachineProfile& machine) {
  return machine.devices.projector == ProjectorKind::Virtual && machine.devices.stage == StageKind::Virtual;
}

std::unique_ptr<Clock> make_clock(const MachineProfile& machine) {
  if (is_simulated(machine) && machine.devices.speed_up != 1)
    return std::make_unique<ScaledClock>(machine.devices.speed_up);
  return std::make_unique<SystemClock>();
}

double stage_top_mm(const MachineProfile& machine) { return machine.platform.z_travel_mm + machine.highest_lift_mm(); }

Result<std::unique_ptr<Dlpc900Projector>> open_projector(const MachineProfile& machine, Clock& clock) {
  if (machine.devices.led_current > 255)
    return fail(ErrorCode::InvalidInput, "machine " + machine.name + ": devices.led_current is above 255");
  auto usb = open_libusb({kTexasInstruments, kDlpc900, machine.devices.projector_serial});
  if (!usb) return tl::unexpected{usb.error()};
  Dlpc900Options options;
  options.mask = machine.mask_size();
  options.orientation = machine.projection.orientation;
  options.controllers = machine.projection.controllers;
  options.led = dlpc900::led_of(machine.devices.led_colour);
  options.inverted_led_polarity = machine.devices.led_polarity == LedPolarity::Inverted;
  options.off_needs_zero_current = machine.devices.led_off == LedOff::EnableAndCurrent;
  options.led_current = static_cast<std::uint8_t>(machine.devices.led_current);
  return Dlpc900Projector::open(std::move(*usb), options, clock);
}

Result<std::unique_ptr<SerialStage>> open_stage(const MachineProfile& machine, Clock& clock) {
  auto line = open_tty(machine.devices.stage_serial);
  if (!line) return tl::unexpected{line.error()};
  SerialStageOptions options;
  options.dialect = machine.devices.stage == StageKind::Marlin ? StageDialect::Marlin : StageDialect::Grbl;
  options.top_mm = stage_top_mm(machine);
  options.thermometer = machine.devices.thermometer;
  options.homing_mm_per_s = machine.homing_mm_per_s();
  options.acceleration_mm_per_s2 = machine.motion.acceleration_mm_per_s2;
  return SerialStage::open(std::move(*line), options, clock);
}

std::unique_ptr<Sensors> thermometer_of(SerialStage& stage) { return std::make_unique<StageThermometer>(stage); }

Result<Devices> make_devices(const MachineProfile& machine, Clock& clock) {
  if (const auto ok = check_statements(machine); !ok) return tl::unexpected{ok.error()};
  Devices devices;
  devices.log = std::make_unique<MachineLog>();
  // The projector first: it goes dark before anything else happens.
  if (machine.devices.projector == ProjectorKind::Virtual) {
    devices.projector = std::make_unique<VirtualProjector>(machine.mask_size(), 0, clock, *devices.log);
  } else {
    auto projector = open_projector(machine, clock);
    if (!projector) return tl::unexpected{projector.error()};
    devices.projector = std::move(*projector);
  }
  if (machine.devices.stage == StageKind::Virtual) {
    devices.stage = std::make_unique<VirtualZStage>(
        stage_top_mm(machine), clock, *devices.log,
        VirtualStageOptions{machine.homing_mm_per_s(), machine.motion.acceleration_mm_per_s2});
  } else {
    auto stage = open_stage(machine, clock);
    if (!stage) return tl::unexpected{stage.error()};
    if (machine.devices.thermometer != Thermometer::None) devices.sensors = thermometer_of(**stage);
    devices.stage = std::move(*stage);
  }
  return devices;
}

}  // namespace telefab::fab
