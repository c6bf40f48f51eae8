// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <telefab/fab/drivers/usbip_session.hpp>
#include <utility>

namespace telefab::fab {

namespace {

constexpr std::uint16_t kVersion = 0x0111;
constexpr std::uint16_t kAskList = 0x8005, kGiveList = 0x0005, kAskImport = 0x8003, kGiveImport = 0x0003;
constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kSubmitDone = 3, kUnlinkDone = 4;
constexpr std::size_t kOperationBytes = 8, kBusIdBytes = 32, kPathBytes = 256, kCommandHeaderBytes = 48;
constexpr std::uint32_t kLargestTransfer = 64 * 1024;
constexpr std::uint32_t kFullSpeed = 2;
constexpr std::int32_t kPipe = -32, kProtocol = -71, kShutdown = -108, kConnectionReset = -104;
constexpr std::size_t kMostPending = 256;

std::uint32_t get32(std::span<const std::byte> b, std::size_t at) {
  std::uint32_t v = 0;
  for (std::size_t i = 0; i < 4; ++i) v = v << 8 | static_cast<std::uint32_t>(b[at + i]);
  return v;
}

std::uint16_t get16(std::span<const std::byte> b, std::size_t at) {
  return static_cast<std::uint16_t>(static_cast<unsigned>(b[at]) << 8 | static_cast<unsigned>(b[at + 1]));
}

std::int32_t status_of(UsbOutcome outcome) {
  switch (outcome) {
    case UsbOutcome::Ok:
    case UsbOutcome::Nak:
      return 0;
    case UsbOutcome::Stall:
      return kPipe;
    case UsbOutcome::Error:
      return kProtocol;
    case UsbOutcome::Gone:
      return kShutdown;
  }
  return kProtocol;
}

std::string bus_id(std::size_t index) { return fmt::format("1-{}", index + 1); }

}  // namespace

void UsbIpSession::put32(std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out_.push_back(std::byte(value >> shift & 0xFF));
}

std::vector<std::byte> UsbIpSession::take() { return std::exchange(out_, {}); }

Result<void> UsbIpSession::feed(std::span<const std::byte> bytes) {
  in_.insert(in_.end(), bytes.begin(), bytes.end());
  while (true) {
    const auto more = attached_ != nullptr ? take_command() : take_operation();
    if (!more) return tl::unexpected{more.error()};
    if (!*more) return {};
  }
}

void UsbIpSession::put_device(std::size_t index) {
  const UsbPeer& peer = *peers_[index];
  const auto d = peer.device_descriptor();
  const auto put_text = [&](const std::string& text, std::size_t bytes) {
    const std::size_t at = out_.size();
    out_.resize(at + bytes);
    std::memcpy(out_.data() + at, text.data(), std::min(text.size(), bytes - 1));
  };
  put_text("/sys/devices/telefab/" + bus_id(index), kPathBytes);
  put_text(bus_id(index), kBusIdBytes);
  put32(1);
  put32(static_cast<std::uint32_t>(index + 1));
  put32(kFullSpeed);
  for (const std::size_t at : {8u, 10u, 12u}) {  // vendor, product, release: little endian there, big endian here
    out_.push_back(std::byte{d[at + 1]});
    out_.push_back(std::byte{d[at]});
  }
  for (const std::size_t at : {4u, 5u, 6u}) out_.push_back(std::byte{d[at]});
  out_.push_back(std::byte{1});                        // configuration in use
  out_.push_back(std::byte{d[17]});                    // number of configurations
  out_.push_back(std::byte{peer.configuration()[4]});  // number of interfaces
}

Result<bool> UsbIpSession::take_operation() {
  if (in_.size() < kOperationBytes) return false;
  const std::uint16_t code = get16(in_, 2);
  if (get16(in_, 0) != kVersion) return fail(ErrorCode::ProtocolBroken, "USB/IP: another version than 1.1.1");
  const auto head = [&](std::uint16_t reply, std::uint32_t status) {
    put32(static_cast<std::uint32_t>(kVersion) << 16 | reply);
    put32(status);
  };
  if (code == kAskList) {
    in_.erase(in_.begin(), in_.begin() + kOperationBytes);
    head(kGiveList, 0);
    put32(static_cast<std::uint32_t>(peers_.size()));
    for (std::size_t i = 0; i < peers_.size(); ++i) {
      put_device(i);
      const auto c = peers_[i]->configuration();
      for (std::size_t at = 0; at < c.size(); at += c[at])
        if (c[at + 1] == 4)
          for (const std::uint8_t byte : {c[at + 5], c[at + 6], c[at + 7], std::uint8_t{0}})
            out_.push_back(std::byte{byte});
    }
    return true;
  }
  if (code != kAskImport) return fail(ErrorCode::ProtocolBroken, fmt::format("USB/IP: unknown request {:#06x}", code));
  if (in_.size() < kOperationBytes + kBusIdBytes) return false;
  const char* name = reinterpret_cast<const char*>(in_.data()) + kOperationBytes;
  const std::string id{name, ::strnlen(name, kBusIdBytes)};
  in_.erase(in_.begin(), in_.begin() + kOperationBytes + kBusIdBytes);
  for (std::size_t i = 0; i < peers_.size(); ++i)
    if (id == bus_id(i)) {
      head(kGiveImport, 0);
      put_device(i);
      attached_ = peers_[i];
      attached_->attached();
      return true;
    }
  head(kGiveImport, 1);
  return true;
}

Result<bool> UsbIpSession::take_command() {
  if (in_.size() < kCommandHeaderBytes) return false;
  const std::uint32_t command = get32(in_, 0), sequence = get32(in_, 4), direction = get32(in_, 12),
                      endpoint = get32(in_, 16);
  if (command == kUnlink) {
    const std::uint32_t victim = get32(in_, 20);
    in_.erase(in_.begin(), in_.begin() + kCommandHeaderBytes);
    const auto found =
        std::find_if(pending_.begin(), pending_.end(), [&](const Submitted& s) { return s.sequence == victim; });
    const bool unlinked = found != pending_.end();
    if (unlinked) pending_.erase(found);
    for (const std::uint32_t v : {kUnlinkDone, sequence, 0u, 0u, 0u}) put32(v);
    put32(unlinked ? static_cast<std::uint32_t>(kConnectionReset) : 0);
    out_.resize(out_.size() + 24);
    return true;
  }
  if (command != kSubmit || direction > 1 || endpoint > 15)
    return fail(ErrorCode::ProtocolBroken, "USB/IP: no such command");
  const std::uint32_t length = get32(in_, 24);
  if (length > kLargestTransfer || pending_.size() >= kMostPending)
    return fail(ErrorCode::ProtocolBroken, "USB/IP: too much at once");
  const std::size_t whole = kCommandHeaderBytes + (direction == 0 ? length : 0);
  if (in_.size() < whole) return false;
  Submitted urb{sequence, static_cast<std::uint8_t>(endpoint | direction << 7), length, {}, {}};
  std::memcpy(urb.setup.data(), in_.data() + 40, urb.setup.size());
  urb.data.assign(in_.begin() + kCommandHeaderBytes, in_.begin() + static_cast<std::ptrdiff_t>(whole));
  in_.erase(in_.begin(), in_.begin() + static_cast<std::ptrdiff_t>(whole));
  if (!complete(urb)) pending_.push_back(std::move(urb));
  return true;
}

void UsbIpSession::advance() {
  for (auto urb = pending_.begin(); urb != pending_.end();) urb = complete(*urb) ? pending_.erase(urb) : std::next(urb);
}

bool UsbIpSession::complete(Submitted& urb) {
  const bool in = (urb.endpoint & 0x80) != 0;
  if ((urb.endpoint & 0x0F) == 0) {
    const UsbOutcome outcome = control(urb);
    const std::size_t n = in ? std::min<std::size_t>(urb.data.size(), urb.length) : 0;
    answer(urb, outcome, std::span{urb.data}.first(n), in ? static_cast<std::uint32_t>(n) : urb.length);
    return true;
  }
  std::vector<std::byte> got;
  const UsbOutcome outcome = in ? attached_->in(urb.endpoint, urb.length, got) : attached_->out(urb.endpoint, urb.data);
  if (outcome == UsbOutcome::Nak) return false;
  const std::size_t n = std::min<std::size_t>(got.size(), urb.length);
  answer(urb, outcome, std::span{got}.first(n), in ? static_cast<std::uint32_t>(n) : urb.length);
  return true;
}

UsbOutcome UsbIpSession::control(Submitted& urb) {
  const auto& s = urb.setup;
  const auto give = [&](std::span<const std::uint8_t> bytes) {
    const auto raw = std::as_bytes(bytes);
    urb.data.assign(raw.begin(), raw.end());
    return UsbOutcome::Ok;
  };
  const bool standard_device = s[0] == 0x80 || s[0] == 0x00;
  if (standard_device && s[1] == 6 && s[3] == 1) return give(attached_->device_descriptor());
  if (standard_device && s[1] == 6 && s[3] == 2) return give(attached_->configuration());
  if (standard_device && s[1] == 6 && s[3] == 3) {
    if (s[2] == 0) return give(std::array<std::uint8_t, 4>{4, 3, 9, 4});
    const std::string text = attached_->text(s[2]);
    if (text.empty()) return UsbOutcome::Stall;
    std::vector<std::uint8_t> d{static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
    for (const char c : text) d.insert(d.end(), {static_cast<std::uint8_t>(c), 0});
    return give(d);
  }
  if (s[0] == 0x80 && s[1] == 0) return give(std::array<std::uint8_t, 2>{0, 0});  // status
  if (s[0] == 0x00 && s[1] == 9) return UsbOutcome::Ok;                           // set configuration
  if (s[0] == 0x01 && s[1] == 11) return UsbOutcome::Ok;                          // set interface
  if (s[0] == 0x02 && s[1] == 1) {                                                // clear halt
    attached_->clear_halt(s[4]);
    return UsbOutcome::Ok;
  }
  return attached_->class_request(s, urb.data);
}

void UsbIpSession::answer(const Submitted& urb, UsbOutcome outcome, std::span<const std::byte> in_data,
                          std::uint32_t length) {
  const bool ok = outcome == UsbOutcome::Ok;
  for (const std::uint32_t v : {kSubmitDone, urb.sequence, 0u, 0u, 0u}) put32(v);
  put32(static_cast<std::uint32_t>(status_of(outcome)));
  put32(ok ? length : 0);
  out_.resize(out_.size() + 20);  // start frame, packets, errors, padding
  if (ok) out_.insert(out_.end(), in_data.begin(), in_data.end());
}

}  // namespace telefab::fab
