// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <cmath>

#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/drivers/grbl_stage.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/drivers/stage_lit_projector.hpp>
#include <telefab/fab/screen/guarded_display.hpp>
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

StageDialect dialect_of(const MachineProfile& machine) {
  return machine.devices.stage == StageKind::Marlin ? StageDialect::Marlin : StageDialect::Grbl;
}

BoardLight light_of(const MachineProfile& machine) {
  const auto& light = machine.light;
  return {light.command, light.number, light.power, light.steps, light.packet_bytes};
}

PanelLayout layout_of(const MachineProfile& machine) {
  const auto& screen = machine.screen;
  return {{screen.width_px, screen.height_px}, screen.packing, machine.projection.orientation, screen.rotation};
}

/// Of a light that the stage's board switches.
Result<void> check_stage_light(const MachineProfile& machine) {
  const auto wrong = [&](std::string_view what) {
    return fail(ErrorCode::InvalidInput, "machine " + machine.name + ": " + std::string{what});
  };
  const auto& d = machine.devices;
  if (d.light != LightSwitch::Stage) return {};
  if (d.stage == StageKind::Virtual)
    return wrong("devices.light = \"stage\" needs a board: state devices.stage, grbl or marlin");
  if (d.projector == ProjectorKind::Virtual)
    return wrong(
        "devices.light = \"stage\" needs something that shows the masks: state devices.projector, screen or "
        "dlpc900");
  if ((d.stage == StageKind::Grbl) != (machine.light.command == LightCommand::Spindle))
    return wrong("state light.command: \"spindle\" of a GRBL board, \"fan\" or \"pin\" of a Marlin board");
  if (d.projector == ProjectorKind::Dlpc900 && d.led_current != 0)
    return wrong(
        "the stage's board switches the light, so the controller drives no LED: state devices.led_current = 0");
  constexpr double kUsualWord = 1000;
  for (const auto& [exposure_s, share] : {std::pair{machine.layers.exposure_s, machine.layers.light_share},
                                          {machine.layers.bottom_exposure_s, machine.light_share_of_layer(0)}}) {
    const LightOrder order{Microseconds{std::llround(exposure_s * 1e6)}, share};
    if (const auto group = light_group(dialect_of(machine), light_of(machine), kUsualWord, order); !group)
      return wrong(group.error().what);
  }
  return {};
}

Result<void> check_screen(const MachineProfile& machine) {
  const auto wrong = [&](std::string_view what) {
    return fail(ErrorCode::InvalidInput, "machine " + machine.name + ": " + std::string{what});
  };
  const auto& d = machine.devices;
  if (d.projector != ProjectorKind::Screen) return {};
  if (machine.screen.connector.empty() || machine.screen.width_px == 0 || machine.screen.height_px == 0)
    return wrong(
        "state which screen shows its masks, screen.connector, width_px and height_px; `telefab-fab probe` "
        "lists what there is");
  if (const auto fits = check_fits(machine.mask_size(), layout_of(machine)); !fits) return wrong(fits.error().what);
  if (d.light == LightSwitch::Stage) return {};
  if (d.led_cutoff == LedCutoff::None)
    return wrong(
        "the lamp behind its screen is always on, so nothing would darken it where this computer dies; let the "
        "stage's board switch it (devices.light = \"stage\"), or put a watchdog before it and state "
        "devices.led_cutoff = \"watchdog\" (deploy/docs/first-light-screens.md)");
  for (const double share : {machine.layers.light_share, machine.light_share_of_layer(0)})
    if (const auto step = light_step(share, 1); !step) return wrong(step.error().what);
  return {};
}

}  // namespace

/// What a print needs to be told about real devices.
Result<void> check_devices(const MachineProfile& machine) {
  const auto wrong = [&](std::string_view what) {
    return fail(ErrorCode::InvalidInput, "machine " + machine.name + ": " + std::string{what});
  };
  const auto& d = machine.devices;
  if (d.projector == ProjectorKind::Dlpc900 && d.led_polarity == LedPolarity::Unstated)
    return wrong(
        "state devices.led_polarity, normal or inverted, as the board's maker says (fab_site/drivers/first-light.md)");
  if (d.projector == ProjectorKind::Dlpc900 && d.light == LightSwitch::Projector && d.led_current == 0)
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
  if (d.projector == ProjectorKind::Dlpc900 && d.light == LightSwitch::Projector)
    for (const double share : {machine.layers.light_share, machine.light_share_of_layer(0)})
      if (const auto step = light_step(share, d.led_current); !step) return wrong(step.error().what);
  if (d.thermometer != Thermometer::None && d.stage != StageKind::Marlin)
    return wrong("devices.thermometer needs stage = \"marlin\"; GRBL boards and virtual stages have none");
  if ((d.hottest_celsius > 0 || d.coldest_celsius > 0) && d.thermometer == Thermometer::None)
    return wrong("temperature limits need devices.thermometer");
  if (d.hottest_celsius > 0 && d.hottest_celsius <= d.coldest_celsius)
    return wrong("devices.hottest_celsius is not above devices.coldest_celsius");
  if (const auto ok = check_screen(machine); !ok) return ok;
  return check_stage_light(machine);
}

bool is_simulated(const MachineProfile& machine) {
  return machine.devices.projector == ProjectorKind::Virtual && machine.devices.stage == StageKind::Virtual &&
         machine.devices.printer == PrinterKind::None;
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
  options.dialect = dialect_of(machine);
  if (machine.devices.light == LightSwitch::Stage) options.light = light_of(machine);
  options.top_mm = stage_top_mm(machine);
  options.thermometer = machine.devices.thermometer;
  options.homing_mm_per_s = machine.homing_mm_per_s();
  options.acceleration_mm_per_s2 = machine.motion.acceleration_mm_per_s2;
  return SerialStage::open(std::move(*line), options, clock);
}

std::unique_ptr<Sensors> thermometer_of(SerialStage& stage) { return std::make_unique<StageThermometer>(stage); }

Result<std::unique_ptr<ScreenProjector>> open_screen(const MachineProfile& machine, Clock& clock) {
  auto display = open_guarded_display(screen_settings(machine), own_guard_program(), clock);
  if (!display) return tl::unexpected{display.error()};
  ScreenOptions options;
  options.mask = machine.mask_size();
  options.layout = layout_of(machine);
  options.latency_frames = machine.devices.light == LightSwitch::Stage ? machine.screen.latency_frames : 0;
  return ScreenProjector::open(std::move(*display), options, clock);
}

namespace {

Result<std::unique_ptr<Projector>> open_picture(const MachineProfile& machine, Clock& clock) {
  if (machine.devices.projector == ProjectorKind::Screen) return open_screen(machine, clock);
  return open_projector(machine, clock);
}

}  // namespace

Result<void> darken(const MachineProfile& machine, Clock& clock) {
  // The lamp first: its board restarts when it is opened.
  Result<void> unlit;
  if (machine.devices.light == LightSwitch::Stage && machine.devices.stage != StageKind::Virtual)
    if (const auto stage = open_stage(machine, clock); !stage) unlit = tl::unexpected{stage.error()};
  if (machine.devices.projector == ProjectorKind::Virtual) return unlit;
  const auto projector = open_picture(machine, clock);  // dark when it is open
  if (!projector) return unlit ? tl::unexpected{projector.error()} : unlit;
  const auto black = (*projector)->dark();
  return unlit ? black : unlit;
}

Result<Devices> make_devices(const MachineProfile& machine, Clock& clock) {
  if (machine.devices.printer != PrinterKind::None)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("{} is a whole printer (devices.printer = \"{}\"), which has light and stage of its own; send "
                    "it a plan with: telefab-fab send PLAN",
                    machine.name, name_of(machine.devices.printer)));
  if (const auto ok = check_devices(machine); !ok) return tl::unexpected{ok.error()};
  Devices devices;
  devices.log = std::make_unique<MachineLog>();
  SerialStage* board = nullptr;
  const auto make_stage = [&]() -> Result<void> {
    if (machine.devices.stage == StageKind::Virtual) {
      devices.stage = std::make_unique<VirtualZStage>(
          stage_top_mm(machine), clock, *devices.log,
          VirtualStageOptions{machine.homing_mm_per_s(), machine.motion.acceleration_mm_per_s2});
      return {};
    }
    auto stage = open_stage(machine, clock);
    if (!stage) return tl::unexpected{stage.error()};
    if (machine.devices.thermometer != Thermometer::None) devices.sensors = thermometer_of(**stage);
    board = stage->get();
    devices.stage = std::move(*stage);
    return {};
  };
  // What makes the light first: it goes dark before anything else happens.
  const bool is_lit_by_board = machine.devices.light == LightSwitch::Stage;
  if (is_lit_by_board)
    if (const auto ok = make_stage(); !ok) return tl::unexpected{ok.error()};
  if (machine.devices.projector == ProjectorKind::Virtual) {
    devices.projector = std::make_unique<VirtualProjector>(machine.mask_size(), 0, clock, *devices.log);
  } else {
    auto picture = open_picture(machine, clock);
    if (!picture) return tl::unexpected{picture.error()};
    devices.projector = std::move(*picture);
  }
  if (is_lit_by_board) {
    auto engine = StageLitProjector::open(std::move(devices.projector), *board, clock);
    if (!engine) return tl::unexpected{engine.error()};
    devices.projector = std::move(*engine);
  } else {
    if (const auto ok = make_stage(); !ok) return tl::unexpected{ok.error()};
  }
  return devices;
}

}  // namespace telefab::fab
