// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/drivers/model_transport.hpp>

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

Error error_of(UsbOutcome outcome) {
  switch (outcome) {
    case UsbOutcome::Nak:
      return {ErrorCode::DeviceTimeout, "the device took and gave nothing in time"};
    case UsbOutcome::Stall:
      return {ErrorCode::DeviceRefused, "the endpoint is halted"};
    case UsbOutcome::Error:
      return {ErrorCode::DeviceLost, "broken transfer"};
    case UsbOutcome::Gone:
      return {ErrorCode::DeviceLost, "the device is gone"};
    case UsbOutcome::Ok:
      break;
  }
  return {ErrorCode::Internal, "no error"};
}

}  // namespace

Result<void> ModelUsb::write(std::uint8_t endpoint, std::span<const std::byte> bytes, Milliseconds timeout) {
  const auto reports = static_cast<int>((bytes.size() + dlpc900::kReportBytes - 1) / dlpc900::kReportBytes);
  clock_.sleep_for(Milliseconds{reports * static_cast<int>(model_.ms_per_report())});
  const UsbOutcome outcome = model_.out(endpoint, bytes);
  if (outcome == UsbOutcome::Ok) return {};
  if (outcome == UsbOutcome::Nak) clock_.sleep_for(timeout);
  return tl::unexpected{error_of(outcome)};
}

Result<std::vector<std::byte>> ModelUsb::read(std::uint8_t endpoint, std::size_t max_bytes, Milliseconds timeout) {
  clock_.sleep_for(Milliseconds{model_.ms_per_report()});
  std::vector<std::byte> reply;
  const UsbOutcome outcome = model_.in(endpoint, reply);
  if (outcome == UsbOutcome::Nak) clock_.sleep_for(timeout);
  if (outcome != UsbOutcome::Ok) return tl::unexpected{error_of(outcome)};
  if (reply.size() > max_bytes) return fail(ErrorCode::ProtocolBroken, "the device sent more than was asked for");
  return reply;
}

Result<void> ModelUsb::clear_halt(std::uint8_t endpoint) {
  if (!model_.present()) return tl::unexpected{error_of(UsbOutcome::Gone)};
  model_.clear_halt(endpoint);
  return {};
}

Result<void> ModelUsb::reopen() {
  model_.reopened();
  return {};
}

Result<void> ModelLine::write(std::string_view bytes, Milliseconds) {
  if (!model_.receive(bytes)) return fail(ErrorCode::DeviceLost, "the line hung up");
  return {};
}

Result<std::optional<std::string>> ModelLine::read_line(Milliseconds timeout) {
  const Nanoseconds until = clock_.now() + timeout;
  while (true) {
    if (!model_.present()) return fail(ErrorCode::DeviceLost, "the line hung up");
    buffer_ += model_.transmit();
    while (!buffer_.empty() && (buffer_.front() == '\r' || buffer_.front() == '\n')) buffer_.erase(0, 1);
    if (const std::size_t end = buffer_.find_first_of("\r\n"); end != std::string::npos) {
      std::string line = buffer_.substr(0, end);
      buffer_.erase(0, end + 1);
      return line;
    }
    if (clock_.now() >= until) return std::nullopt;
    clock_.sleep_for(1ms);
  }
}

Result<void> ModelLine::reopen() {
  buffer_.clear();
  model_.reopened();
  return {};
}

}  // namespace telefab::fab
