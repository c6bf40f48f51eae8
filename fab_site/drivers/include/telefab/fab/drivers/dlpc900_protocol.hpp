// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/fab/mask/mask.hpp>
#include <vector>

namespace telefab::fab::dlpc900 {

// The DLPC900's HID wire format (DLPU018F 1.2). Every command we ever send stands in this enum; those that write flash
// or start the boot loader do not exist here, so no mistake can send one.
enum class Command : std::uint16_t {
  ErrorCodeOf = 0x0100,
  PowerMode = 0x0200,
  DmdIdle = 0x0201,
  Version = 0x0205,
  DmdType = 0x0206,
  DmdPark = 0x0609,
  LedCurrent = 0x0B01,
  FlipLongAxis = 0x1008,
  FlipShortAxis = 0x1009,
  LedPolarity = 0x1A05,
  LedEnable = 0x1A07,
  HardwareStatus = 0x1A0A,
  SystemStatus = 0x1A0B,
  MainStatus = 0x1A0C,
  DisplayMode = 0x1A1B,
  PatternStartStop = 0x1A24,
  ImageBegin = 0x1A2A,
  ImageBlock = 0x1A2B,
  SecondImageBegin = 0x1A2C,
  SecondImageBlock = 0x1A2D,
  PatternConfiguration = 0x1A31,
  PatternDefinition = 0x1A34,
};
[[nodiscard]] std::string_view name_of(Command command);

inline constexpr std::uint8_t kOutEndpoint = 0x01;
inline constexpr std::uint8_t kInEndpoint = 0x81;
inline constexpr std::size_t kReportBytes = 64;
inline constexpr std::size_t kCommandBytes = 512;  ///< header, command and data of one command at most
inline constexpr std::size_t kBlockBytes = 504;    ///< image bytes of one block command
inline constexpr std::uint32_t kLongestExposure_us = 16'777'215;

inline constexpr std::uint8_t kRead = 0xC0;          ///< flags of a query
inline constexpr std::uint8_t kWriteReplied = 0x40;  ///< flags of a write that is answered
inline constexpr std::uint8_t kWrite = 0x00;
inline constexpr std::uint8_t kErrorFlag = 0x20;  ///< in replies

/// A command as reports: header in the first, zeros behind the last byte. Size is a multiple of kReportBytes.
[[nodiscard]] std::vector<std::byte> frame(std::uint8_t flags, std::uint8_t sequence, Command command,
                                           std::span<const std::byte> data);

struct Reply {
  std::uint8_t flags = 0;
  std::uint8_t sequence = 0;
  std::vector<std::byte> data;
};
/// ProtocolBroken when the report is too short for what its header says.
[[nodiscard]] Result<Reply> parse_reply(std::span<const std::byte> report);

/// LED bits of a pattern and of LedEnable.
enum class Led : std::uint8_t { Red = 1, Green = 2, Blue = 4 };
[[nodiscard]] Led led_of(LedColour colour);

/// The 12 bytes of a pattern definition: image 0, bit 0, eight bits deep, no triggers, no dark time.
[[nodiscard]] std::array<std::byte, 12> pattern_definition(std::uint32_t exposure_us, Led led);

inline constexpr std::uint8_t kLedsOff = 0x00;
inline constexpr std::uint8_t kLedsBySequencer = 0x08;
inline constexpr std::uint8_t kModeOnTheFly = 3;
inline constexpr std::uint8_t kStop = 0;
inline constexpr std::uint8_t kStart = 2;

// bits of HardwareStatus, SystemStatus, MainStatus
inline constexpr std::uint8_t kHardwareInitOk = 0x01;
inline constexpr std::uint8_t kHardwareWrongDmd = 0x02;
inline constexpr std::uint8_t kHardwareResetError = 0x04;
inline constexpr std::uint8_t kHardwareSecondReady = 0x10;
inline constexpr std::uint8_t kHardwareSequencerAbort = 0x40;
inline constexpr std::uint8_t kHardwareSequencerError = 0x80;
inline constexpr std::uint8_t kHardwareFaults =
    kHardwareWrongDmd | kHardwareResetError | kHardwareSequencerAbort | kHardwareSequencerError;
inline constexpr std::uint8_t kSystemMemoryOk = 0x01;
inline constexpr std::uint8_t kMainParked = 0x01;
inline constexpr std::uint8_t kMainRunning = 0x02;

/// A mirror array as DmdType names it.
struct DmdFacts {
  std::uint8_t type;
  std::string_view name;
  PixelSize size;
  bool two_controllers;                ///< each shows one half of the columns
  std::uint32_t shortest_exposure_us;  ///< at eight bits (DLPU018F table 2-103)
};
[[nodiscard]] std::optional<DmdFacts> dmd_facts(std::uint8_t type);

/// What differs between firmware versions (DLPT028, DLPU018J).
struct FirmwareFacts {
  std::uint8_t first_major, first_minor;  ///< from this version on
  bool park_after_mode_change;            ///< mirrors can lock otherwise
  bool configuration_before_images;       ///< and after them, always
  std::string_view note;
};
[[nodiscard]] const FirmwareFacts& firmware_facts(std::uint8_t major, std::uint8_t minor);

/// Text of a device error code (DLPU018F, 0x0100).
[[nodiscard]] std::string_view error_text(std::uint8_t code);

}  // namespace telefab::fab::dlpc900
