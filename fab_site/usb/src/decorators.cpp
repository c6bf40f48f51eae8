// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <optional>
#include <telefab/fab/usb/decorators.hpp>

namespace telefab::fab {

namespace {

using Call = UsbExchange::Call;
constexpr std::string_view kCallLetters = "wrho";

std::vector<std::byte> copy(std::span<const std::byte> bytes) { return {bytes.begin(), bytes.end()}; }

template <class T>
int code_of(const Result<T>& result) {
  return result ? 0 : static_cast<int>(result.error().code);
}

}  // namespace

std::string to_text(std::span<const UsbExchange> transcript) {
  std::string text;
  for (const UsbExchange& e : transcript) {
    text += fmt::format("{} {:02x}", kCallLetters[static_cast<std::size_t>(e.call)], e.endpoint);
    if (!e.bytes.empty()) text += ' ';
    for (const std::byte b : e.bytes) text += fmt::format("{:02x}", static_cast<unsigned>(b));
    if (e.error != 0) text += fmt::format(" !{}", e.error);
    text += '\n';
  }
  return text;
}

Result<std::vector<UsbExchange>> transcript_from_text(std::string_view text) {
  std::vector<UsbExchange> transcript;
  std::size_t line_number = 0;
  const auto hex_byte = [](std::string_view two) -> std::optional<std::uint8_t> {
    std::uint8_t value = 0;
    if (two.size() != 2 || std::from_chars(two.data(), two.data() + 2, value, 16).ptr != two.data() + 2)
      return std::nullopt;
    return value;
  };
  while (!text.empty()) {
    ++line_number;
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    if (line.empty() || line[0] == '#') continue;
    const auto bad = [&] {
      return fail(ErrorCode::InvalidInput, fmt::format("USB transcript, line {}: not an exchange", line_number));
    };
    UsbExchange e;
    const std::size_t call = kCallLetters.find(line[0]);
    const auto endpoint = line.size() >= 4 ? hex_byte(line.substr(2, 2)) : std::nullopt;
    if (call == std::string_view::npos || line[1] != ' ' || !endpoint) return bad();
    e.call = static_cast<Call>(call);
    e.endpoint = *endpoint;
    std::string_view rest = line.substr(4);
    if (const std::size_t mark = rest.find(" !"); mark != std::string_view::npos) {
      const std::string_view code = rest.substr(mark + 2);
      if (std::from_chars(code.data(), code.data() + code.size(), e.error).ptr != code.data() + code.size() ||
          e.error <= 0)
        return bad();
      rest = rest.substr(0, mark);
    }
    if (!rest.empty() && rest[0] == ' ') rest.remove_prefix(1);
    for (; !rest.empty(); rest.remove_prefix(2)) {
      const auto value = hex_byte(rest.substr(0, 2));
      if (!value) return bad();
      e.bytes.push_back(std::byte{*value});
    }
    transcript.push_back(std::move(e));
  }
  return transcript;
}

Result<void> RecordingUsb::write(std::uint8_t endpoint, std::span<const std::byte> bytes, Milliseconds timeout) {
  auto done = inner_.write(endpoint, bytes, timeout);
  transcript_.push_back({Call::Write, endpoint, copy(bytes), code_of(done)});
  return done;
}

Result<std::vector<std::byte>> RecordingUsb::read(std::uint8_t endpoint, std::size_t max_bytes, Milliseconds timeout) {
  auto got = inner_.read(endpoint, max_bytes, timeout);
  transcript_.push_back({Call::Read, endpoint, got ? *got : std::vector<std::byte>{}, code_of(got)});
  return got;
}

Result<void> RecordingUsb::clear_halt(std::uint8_t endpoint) {
  auto done = inner_.clear_halt(endpoint);
  transcript_.push_back({Call::ClearHalt, endpoint, {}, code_of(done)});
  return done;
}

Result<void> RecordingUsb::reopen() {
  auto done = inner_.reopen();
  transcript_.push_back({Call::Reopen, 0, {}, code_of(done)});
  return done;
}

Result<UsbExchange> ReplayUsb::expect(Call call, std::uint8_t endpoint, std::span<const std::byte> written) {
  const auto differs = [&](std::string_view what) {
    broken_ = true;
    return fail(ErrorCode::ProtocolBroken, fmt::format("replay, exchange {}: {}", at_, what));
  };
  if (broken_) return fail(ErrorCode::ProtocolBroken, "replay: differed before");
  if (at_ == transcript_.size()) return differs("the transcript is over");
  const UsbExchange& e = transcript_[at_];
  if (e.call != call || e.endpoint != endpoint) return differs("another call was recorded here");
  if (call == Call::Write && !std::ranges::equal(e.bytes, written)) return differs("other bytes were recorded here");
  ++at_;
  if (e.error != 0) return fail(static_cast<ErrorCode>(e.error), "replay: failed when it was recorded");
  return e;
}

Result<void> ReplayUsb::write(std::uint8_t endpoint, std::span<const std::byte> bytes, Milliseconds) {
  const auto e = expect(Call::Write, endpoint, bytes);
  if (!e) return tl::unexpected{e.error()};
  return {};
}

Result<std::vector<std::byte>> ReplayUsb::read(std::uint8_t endpoint, std::size_t, Milliseconds) {
  auto e = expect(Call::Read, endpoint, {});
  if (!e) return tl::unexpected{e.error()};
  return std::move(e->bytes);
}

Result<void> ReplayUsb::clear_halt(std::uint8_t endpoint) {
  const auto e = expect(Call::ClearHalt, endpoint, {});
  if (!e) return tl::unexpected{e.error()};
  return {};
}

Result<void> ReplayUsb::reopen() {
  const auto e = expect(Call::Reopen, 0, {});
  if (!e) return tl::unexpected{e.error()};
  return {};
}

Result<void> FailingUsb::write(std::uint8_t endpoint, std::span<const std::byte> bytes, Milliseconds timeout) {
  if (fails_now()) return fail(code_, "broken on purpose");
  return inner_.write(endpoint, bytes, timeout);
}

Result<std::vector<std::byte>> FailingUsb::read(std::uint8_t endpoint, std::size_t max_bytes, Milliseconds timeout) {
  if (fails_now()) return fail(code_, "broken on purpose");
  return inner_.read(endpoint, max_bytes, timeout);
}

Result<void> FailingUsb::clear_halt(std::uint8_t endpoint) {
  if (fails_now()) return fail(code_, "broken on purpose");
  return inner_.clear_halt(endpoint);
}

Result<void> FailingUsb::reopen() {
  if (fails_now()) return fail(code_, "broken on purpose");
  return inner_.reopen();
}

}  // namespace telefab::fab
