// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/fab/drivers/dlpc900_projector.hpp>
#include <utility>

namespace telefab::fab {

using namespace dlpc900;

namespace {

constexpr Milliseconds kTimeout{1000};
constexpr int kTries = 4;
constexpr int kForeignReplies = 8;

}  // namespace

Result<std::vector<std::byte>> Dlpc900Link::once(std::uint8_t flags, Command command, std::span<const std::byte> data,
                                                 std::size_t at_least_bytes, Milliseconds timeout) {
  const std::uint8_t sequence = ++sequence_;
  const auto failed = [&](const Error& e) { return fail_in(fmt::format("projector, {}", name_of(command)), e); };
  if (const auto ok = usb_->write(kOutEndpoint, frame(flags, sequence, command, data), timeout); !ok)
    return failed(ok.error());
  for (int i = 0; i < kForeignReplies; ++i) {
    const auto report = usb_->read(kInEndpoint, kReportBytes, timeout);
    if (!report) return failed(report.error());
    auto reply = parse_reply(*report);
    if (!reply) return failed(reply.error());
    if (reply->sequence != sequence) continue;  // an answer that came too late to an earlier question
    if ((reply->flags & kErrorFlag) != 0) {
      const std::uint8_t code = reply->data.empty() ? 0 : static_cast<std::uint8_t>(reply->data[0]);
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("projector, {}: refused with error {} ({})", name_of(command), code, error_text(code)));
    }
    if (reply->data.size() < at_least_bytes)
      return fail(ErrorCode::ProtocolBroken, fmt::format("projector, {}: answered {} bytes, {} expected",
                                                         name_of(command), reply->data.size(), at_least_bytes));
    return std::move(reply->data);
  }
  return fail(ErrorCode::ProtocolBroken,
              fmt::format("projector, {}: no answer to it among its replies", name_of(command)));
}

Result<std::vector<std::byte>> Dlpc900Link::patiently(std::uint8_t flags, Command command,
                                                      std::span<const std::byte> data, std::size_t at_least_bytes) {
  for (int i = 1;; ++i) {
    auto answer = once(flags, command, data, at_least_bytes, kTimeout);
    if (answer || i == kTries) return answer;
    ++retries_;
    // A broken transfer may be the cable's moment only. What the device lost by it shows in its mode and status.
    if (answer.error().code == ErrorCode::DeviceLost)
      if (const auto ok = usb_->reopen(); !ok) return answer;
    if (answer.error().code == ErrorCode::DeviceRefused)
      if (const auto ok = clear_halts(); !ok) return tl::unexpected{ok.error()};
  }
}

Result<std::vector<std::byte>> Dlpc900Link::query(Command command, std::size_t at_least_bytes) {
  return patiently(kRead, command, {}, at_least_bytes);
}

Result<std::uint8_t> Dlpc900Link::query_byte(Command command) {
  const auto answer = query(command, 1);
  if (!answer) return tl::unexpected{answer.error()};
  return static_cast<std::uint8_t>((*answer)[0]);
}

Result<void> Dlpc900Link::set(Command command, std::span<const std::byte> data) {
  const auto answer = patiently(kWriteReplied, command, data, 0);
  if (!answer) return tl::unexpected{answer.error()};
  return {};
}

Result<void> Dlpc900Link::set_byte(Command command, std::uint8_t value) {
  const std::byte data[] = {std::byte{value}};
  return set(command, data);
}

Result<void> Dlpc900Link::set_once(Command command, std::span<const std::byte> data, Milliseconds timeout) {
  const auto answer = once(kWriteReplied, command, data, 0, timeout);
  if (!answer) return tl::unexpected{answer.error()};
  return {};
}

Result<void> Dlpc900Link::send(std::span<const std::byte> bytes) { return usb_->write(kOutEndpoint, bytes, kTimeout); }

Result<void> Dlpc900Link::clear_halts() {
  if (const auto ok = usb_->clear_halt(kOutEndpoint); !ok) return ok;
  return usb_->clear_halt(kInEndpoint);
}

Result<void> Dlpc900Link::reopen() {
  ++retries_;
  return usb_->reopen();
}

std::uint32_t Dlpc900Link::take_retries() { return std::exchange(retries_, 0u); }

}  // namespace telefab::fab
