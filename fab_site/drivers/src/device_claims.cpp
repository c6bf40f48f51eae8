// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/drivers/device_claims.hpp>

namespace telefab::fab {

std::string_view name_of(ClaimKind kind) {
  switch (kind) {
    case ClaimKind::LightEngine:
      return "light engine";
    case ClaimKind::StageBoard:
      return "stage";
    case ClaimKind::Screen:
      return "screen";
    case ClaimKind::WholePrinter:
      return "printer";
  }
  return "stage";
}

std::vector<DeviceClaim> devices_of(const MachineProfile& machine) {
  const MachineProfile::Devices& d = machine.devices;
  std::vector<DeviceClaim> claims;
  if (d.printer != PrinterKind::None) {
    const bool has_id = !d.printer_id.empty();
    claims.push_back({ClaimKind::WholePrinter, has_id ? d.printer_id : d.printer_address,
                      has_id ? "devices.printer_id" : "devices.printer_address"});
    return claims;
  }
  if (d.projector == ProjectorKind::Dlpc900)
    claims.push_back({ClaimKind::LightEngine, d.projector_serial, "devices.projector_serial"});
  if (d.projector == ProjectorKind::Screen)
    claims.push_back({ClaimKind::Screen, machine.screen.connector, "screen.connector"});
  if (d.stage != StageKind::Virtual) claims.push_back({ClaimKind::StageBoard, d.stage_serial, "devices.stage_serial"});
  return claims;
}

bool may_be_one(const DeviceClaim& a, const DeviceClaim& b) {
  return a.kind == b.kind && (a.identity == b.identity || a.identity.empty() || b.identity.empty());
}

}  // namespace telefab::fab
