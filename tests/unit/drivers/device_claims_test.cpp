// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/fab/drivers/device_claims.hpp>

namespace telefab::fab {
namespace {

MachineProfile machine(ProjectorKind projector, std::string projector_serial, StageKind stage,
                       std::string stage_serial) {
  MachineProfile profile;
  profile.devices.projector = projector;
  profile.devices.projector_serial = std::move(projector_serial);
  profile.devices.stage = stage;
  profile.devices.stage_serial = std::move(stage_serial);
  return profile;
}

TEST(DeviceClaims, AreNoneOfVirtualDevicesWhateverSerialsAreStated) {
  EXPECT_TRUE(devices_of(machine(ProjectorKind::Virtual, "1", StageKind::Virtual, "2")).empty());
}

TEST(DeviceClaims, NameEachRealDevice) {
  const auto claims = devices_of(machine(ProjectorKind::Dlpc900, "T1", StageKind::Grbl, "G1"));
  ASSERT_EQ(claims.size(), 2U);
  EXPECT_EQ(claims[0].kind, ClaimKind::LightEngine);
  EXPECT_EQ(claims[0].identity, "T1");
  EXPECT_EQ(claims[1].kind, ClaimKind::StageBoard);
  EXPECT_EQ(claims[1].identity, "G1");
}

TEST(DeviceClaims, NameTheConnectorOfAScreen) {
  MachineProfile left = machine(ProjectorKind::Screen, "", StageKind::Virtual, ""), right = left;
  left.screen.connector = "HDMI-A-1";
  right.screen.connector = "HDMI-A-2";
  ASSERT_EQ(devices_of(left).size(), 1U);
  EXPECT_EQ(devices_of(left)[0], (DeviceClaim{ClaimKind::Screen, "HDMI-A-1", "screen.connector"}));
  EXPECT_FALSE(may_be_one(devices_of(left)[0], devices_of(right)[0]));
  EXPECT_TRUE(may_be_one(devices_of(left)[0], devices_of(left)[0]));
}

TEST(DeviceClaims, NameAWholePrinterAndNothingElseOfItsMachine) {
  MachineProfile printer = machine(ProjectorKind::Dlpc900, "", StageKind::Grbl, "");
  printer.devices.printer = PrinterKind::Sdcp;
  printer.devices.printer_address = "10.0.0.7";
  ASSERT_EQ(devices_of(printer).size(), 1U);
  EXPECT_EQ(devices_of(printer)[0], (DeviceClaim{ClaimKind::WholePrinter, "10.0.0.7", "devices.printer_address"}));
  printer.devices.printer_id = "000000000001d354";
  EXPECT_EQ(devices_of(printer)[0].key, "devices.printer_id");
}

TEST(DeviceClaims, MayBeOneDeviceWhereOneOfThemSaysOnlyWhicheverIsFound) {
  const DeviceClaim first{ClaimKind::StageBoard, "G1", {}}, second{ClaimKind::StageBoard, "G2", {}};
  const DeviceClaim any{ClaimKind::StageBoard, "", {}}, light{ClaimKind::LightEngine, "", {}};
  EXPECT_TRUE(may_be_one(first, first));
  EXPECT_FALSE(may_be_one(first, second));
  EXPECT_TRUE(may_be_one(first, any));
  EXPECT_TRUE(may_be_one(any, second));
  EXPECT_TRUE(may_be_one(any, any));
  EXPECT_FALSE(may_be_one(any, light));
}

TEST(DeviceClaims, OfAGrblAndAMarlinStageMayBeOneBoard) {
  const auto grbl = devices_of(machine(ProjectorKind::Virtual, "", StageKind::Grbl, "S"));
  const auto marlin = devices_of(machine(ProjectorKind::Virtual, "", StageKind::Marlin, "S"));
  EXPECT_TRUE(may_be_one(grbl.at(0), marlin.at(0)));
}

}  // namespace
}  // namespace telefab::fab
