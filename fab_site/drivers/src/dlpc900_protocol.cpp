// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/drivers/dlpc900_protocol.hpp>
#include <utility>

namespace telefab::fab::dlpc900 {

namespace {

constexpr std::size_t kHeaderBytes = 4;
constexpr std::size_t kCommandWordBytes = 2;

constexpr std::array kDmds{
    DmdFacts{1, "DLP6500", {1920, 1080}, false, 4046},
    DmdFacts{2, "DLP9000", {2560, 1600}, true, 4046},
    DmdFacts{3, "DLP670S", {2716, 1600}, true, 4046},
    DmdFacts{4, "DLP500YX", {2048, 1200}, true, 2263},
};

// Newest first: the first row not newer than the firmware holds.
constexpr std::array kFirmwares{
    FirmwareFacts{5, 1, false, true, "pattern configuration before the images"},
    FirmwareFacts{5, 0, true, true, "park after a mode change, pattern configuration before the images"},
    FirmwareFacts{4, 1, true, false, "park after a mode change"},
    FirmwareFacts{0, 0, false, false, "first firmwares: parking is not possible"},
};

struct ErrorText {
  std::uint8_t code;
  std::string_view text;
};
constexpr std::array kErrors{
    ErrorText{0, "no error"},
    ErrorText{1, "batch file checksum"},
    ErrorText{2, "device failure"},
    ErrorText{3, "unknown command"},
    ErrorText{4, "wrong mirror array"},
    ErrorText{5, "not allowed in this mode"},
    ErrorText{6, "parameter out of range"},
    ErrorText{7, "something needed is missing"},
    ErrorText{8, "out of memory"},
    ErrorText{9, "wrong compression"},
    ErrorText{10, "wrong number of bits"},
    ErrorText{11, "image missing"},
    ErrorText{12, "wrong dark time"},
    ErrorText{13, "wrong trigger delay"},
    ErrorText{14, "exposure too short"},
    ErrorText{15, "wrong number of patterns"},
    ErrorText{16, "wrong pattern definition"},
    ErrorText{17, "wrong address"},
    ErrorText{255, "internal error"},
};

struct CommandName {
  Command command;
  std::string_view name;
};
constexpr std::array kNames{
    CommandName{Command::ErrorCodeOf, "error-code"},
    CommandName{Command::PowerMode, "power-mode"},
    CommandName{Command::DmdIdle, "dmd-idle"},
    CommandName{Command::Version, "version"},
    CommandName{Command::DmdType, "dmd-type"},
    CommandName{Command::DmdPark, "dmd-park"},
    CommandName{Command::LedCurrent, "led-current"},
    CommandName{Command::FlipLongAxis, "flip-long-axis"},
    CommandName{Command::FlipShortAxis, "flip-short-axis"},
    CommandName{Command::LedPolarity, "led-polarity"},
    CommandName{Command::LedEnable, "led-enable"},
    CommandName{Command::HardwareStatus, "hardware-status"},
    CommandName{Command::SystemStatus, "system-status"},
    CommandName{Command::MainStatus, "main-status"},
    CommandName{Command::DisplayMode, "display-mode"},
    CommandName{Command::PatternStartStop, "pattern-start-stop"},
    CommandName{Command::ImageBegin, "image-begin"},
    CommandName{Command::ImageBlock, "image-block"},
    CommandName{Command::SecondImageBegin, "second-image-begin"},
    CommandName{Command::SecondImageBlock, "second-image-block"},
    CommandName{Command::PatternConfiguration, "pattern-configuration"},
    CommandName{Command::PatternDefinition, "pattern-definition"},
};

}  // namespace

std::string_view name_of(Command command) {
  const auto* row =
      std::find_if(kNames.begin(), kNames.end(), [&](const CommandName& n) { return n.command == command; });
  return row == kNames.end() ? "unknown" : row->name;
}

std::vector<std::byte> frame(std::uint8_t flags, std::uint8_t sequence, Command command,
                             std::span<const std::byte> data) {
  const auto length = static_cast<std::uint16_t>(data.size() + kCommandWordBytes);
  const auto code = static_cast<std::uint16_t>(command);
  const std::size_t used = kHeaderBytes + kCommandWordBytes + data.size();
  std::vector<std::byte> out((used + kReportBytes - 1) / kReportBytes * kReportBytes);
  out[0] = std::byte{flags};
  out[1] = std::byte{sequence};
  out[2] = std::byte(length & 0xFF);
  out[3] = std::byte(length >> 8);
  out[4] = std::byte(code & 0xFF);
  out[5] = std::byte(code >> 8);
  std::copy(data.begin(), data.end(), out.begin() + kHeaderBytes + kCommandWordBytes);
  return out;
}

Result<Reply> parse_reply(std::span<const std::byte> report) {
  if (report.size() < kHeaderBytes)
    return fail(ErrorCode::ProtocolBroken, "the projector's reply is shorter than a header");
  const auto at = [&](std::size_t i) { return static_cast<std::uint8_t>(report[i]); };
  const std::size_t length = at(2) | static_cast<std::size_t>(at(3)) << 8;
  if (length > report.size() - kHeaderBytes)
    return fail(ErrorCode::ProtocolBroken, "the projector's reply is shorter than it says");
  return Reply{at(0),
               at(1),
               {report.begin() + kHeaderBytes, report.begin() + static_cast<std::ptrdiff_t>(kHeaderBytes + length)}};
}

Led led_of(LedColour colour) {
  switch (colour) {
    case LedColour::Red:
      return Led::Red;
    case LedColour::Green:
      return Led::Green;
    case LedColour::Blue:
      return Led::Blue;
  }
  return Led::Blue;
}

std::array<std::byte, 12> pattern_definition(std::uint32_t exposure_us, Led led) {
  constexpr std::uint32_t kEightBits = (8 - 1) << 1;
  constexpr std::uint8_t kNoTriggerOut = 1;
  std::array<std::byte, 12> d{};
  for (std::size_t i = 0; i < 3; ++i) d[2 + i] = std::byte(exposure_us >> (8 * i) & 0xFF);
  d[5] = std::byte(kEightBits | static_cast<std::uint32_t>(led) << 4);
  d[9] = std::byte{kNoTriggerOut};
  return d;
}

std::optional<DmdFacts> dmd_facts(std::uint8_t type) {
  const auto* row = std::find_if(kDmds.begin(), kDmds.end(), [&](const DmdFacts& d) { return d.type == type; });
  if (row == kDmds.end()) return std::nullopt;
  return *row;
}

const FirmwareFacts& firmware_facts(std::uint8_t major, std::uint8_t minor) {
  return *std::find_if(kFirmwares.begin(), kFirmwares.end(), [&](const FirmwareFacts& f) {
    return std::pair{major, minor} >= std::pair{f.first_major, f.first_minor};
  });
}

std::string_view error_text(std::uint8_t code) {
  const auto* row = std::find_if(kErrors.begin(), kErrors.end(), [&](const ErrorText& e) { return e.code == code; });
  return row == kErrors.end() ? "unknown error" : row->text;
}

}  // namespace telefab::fab::dlpc900
