// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string>
#include <string_view>
#include <telefab/fab/usb/usb_transport.hpp>
#include <vector>

namespace telefab::fab {

/// One call on a transport and its answer.
struct UsbExchange {
  enum class Call : std::uint8_t { Write, Read, ClearHalt, Reopen } call = Call::Write;
  std::uint8_t endpoint = 0;
  std::vector<std::byte> bytes;  ///< written or read
  int error = 0;                 ///< ErrorCode, 0: none
  friend bool operator==(const UsbExchange&, const UsbExchange&) = default;
};

/// A transcript as text, one exchange a line: "w 01 <hex>", "r 81 <hex>", "h 01", "o", failures with " !code".
[[nodiscard]] std::string to_text(std::span<const UsbExchange> transcript);
/// InvalidInput names the line.
[[nodiscard]] Result<std::vector<UsbExchange>> transcript_from_text(std::string_view text);

/// Passes everything on and remembers it. The inner transport must outlive it.
class RecordingUsb final : public UsbTransport {
 public:
  explicit RecordingUsb(UsbTransport& inner) : inner_{inner} {}
  [[nodiscard]] Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes,
                                   Milliseconds timeout) override;
  [[nodiscard]] Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t max_bytes,
                                                    Milliseconds timeout) override;
  [[nodiscard]] Result<void> clear_halt(std::uint8_t endpoint) override;
  [[nodiscard]] Result<void> reopen() override;
  [[nodiscard]] std::string describe() const override { return inner_.describe(); }
  [[nodiscard]] const std::vector<UsbExchange>& transcript() const { return transcript_; }

 private:
  UsbTransport& inner_;
  std::vector<UsbExchange> transcript_;
};

/// Answers from a transcript; the first call that differs from it fails with ProtocolBroken, and every one after it.
class ReplayUsb final : public UsbTransport {
 public:
  explicit ReplayUsb(std::vector<UsbExchange> transcript) : transcript_{std::move(transcript)} {}
  [[nodiscard]] Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes,
                                   Milliseconds timeout) override;
  [[nodiscard]] Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t max_bytes,
                                                    Milliseconds timeout) override;
  [[nodiscard]] Result<void> clear_halt(std::uint8_t endpoint) override;
  [[nodiscard]] Result<void> reopen() override;
  [[nodiscard]] std::string describe() const override { return "replay of a transcript"; }
  /// Every exchange was asked for.
  [[nodiscard]] bool finished() const { return at_ == transcript_.size(); }

 private:
  [[nodiscard]] Result<UsbExchange> expect(UsbExchange::Call call, std::uint8_t endpoint,
                                           std::span<const std::byte> written);
  std::vector<UsbExchange> transcript_;
  std::size_t at_ = 0;
  bool broken_ = false;
};

/// Fails `count` calls from the n-th on (from 0) without passing them on. The inner transport must outlive it.
class FailingUsb final : public UsbTransport {
 public:
  FailingUsb(UsbTransport& inner, std::size_t first, std::size_t count, ErrorCode code)
      : inner_{inner}, first_{first}, count_{count}, code_{code} {}
  [[nodiscard]] Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes,
                                   Milliseconds timeout) override;
  [[nodiscard]] Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t max_bytes,
                                                    Milliseconds timeout) override;
  [[nodiscard]] Result<void> clear_halt(std::uint8_t endpoint) override;
  [[nodiscard]] Result<void> reopen() override;
  [[nodiscard]] std::string describe() const override { return inner_.describe(); }
  [[nodiscard]] std::size_t calls() const { return calls_; }

 private:
  [[nodiscard]] bool fails_now() {
    const std::size_t call = calls_++;
    return call >= first_ && call - first_ < count_;
  }
  UsbTransport& inner_;
  std::size_t first_, count_;
  ErrorCode code_;
  std::size_t calls_ = 0;
};

}  // namespace telefab::fab
