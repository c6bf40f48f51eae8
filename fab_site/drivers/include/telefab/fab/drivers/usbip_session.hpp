// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <telefab/fab/drivers/dlpc900_model.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <vector>

namespace telefab::fab {

/// A simulated USB device as a bus sees it: descriptors, control requests, transfers. One caller at a time.
class UsbPeer {
 public:
  virtual ~UsbPeer() = default;
  UsbPeer(const UsbPeer&) = delete;
  UsbPeer& operator=(const UsbPeer&) = delete;

  /// 18 bytes.
  [[nodiscard]] virtual std::span<const std::uint8_t> device_descriptor() const = 0;
  /// Configuration with interfaces and endpoints.
  [[nodiscard]] virtual std::span<const std::uint8_t> configuration() const = 0;
  [[nodiscard]] virtual std::string text(std::uint8_t index) const = 0;  ///< string descriptor; empty: none
  /// Class requests; Stall where there is no such one. IN fills `data`.
  [[nodiscard]] virtual UsbOutcome class_request(std::span<const std::uint8_t, 8> setup,
                                                 std::vector<std::byte>& data) = 0;
  [[nodiscard]] virtual UsbOutcome out(std::uint8_t endpoint, std::span<const std::byte> bytes) = 0;
  [[nodiscard]] virtual UsbOutcome in(std::uint8_t endpoint, std::size_t max_bytes, std::vector<std::byte>& bytes) = 0;
  virtual void clear_halt(std::uint8_t endpoint) = 0;
  virtual void attached() = 0;

 protected:
  UsbPeer() = default;
};

/// The models as USB devices: a DLPC900 HID and a GRBL board behind CDC-ACM. The models must outlive them.
[[nodiscard]] std::unique_ptr<UsbPeer> make_projector_peer(Dlpc900Model& model, std::string serial);
[[nodiscard]] std::unique_ptr<UsbPeer> make_stage_peer(GrblModel& model, std::string serial);

/// One connection of a USB/IP client (Linux, Documentation/usb/usbip_protocol), as bytes: owns no socket. Offers its
/// peers as bus ids 1-1, 1-2, ...; after an import it carries that device's transfers. Limits: a transfer of at most
/// 64 kB; a client that breaks the protocol is refused and the session ends.
class UsbIpSession {
 public:
  /// The peers must outlive the session.
  explicit UsbIpSession(std::vector<UsbPeer*> peers) : peers_{std::move(peers)} {}

  /// Bytes from the client. ProtocolBroken ends the session.
  [[nodiscard]] Result<void> feed(std::span<const std::byte> bytes);
  /// Asks the device again for transfers it had no answer to yet; call it every millisecond.
  void advance();
  /// Bytes for the client since the last call.
  [[nodiscard]] std::vector<std::byte> take();

 private:
  struct Submitted {
    std::uint32_t sequence = 0;
    std::uint8_t endpoint = 0;  ///< 0x80: in
    std::uint32_t length = 0;
    std::array<std::uint8_t, 8> setup{};
    std::vector<std::byte> data;
  };
  [[nodiscard]] Result<bool> take_operation();
  [[nodiscard]] Result<bool> take_command();
  [[nodiscard]] bool complete(Submitted& urb);
  [[nodiscard]] UsbOutcome control(Submitted& urb);
  void answer(const Submitted& urb, UsbOutcome outcome, std::span<const std::byte> in_data, std::uint32_t length);
  void put32(std::uint32_t value);
  void put_device(std::size_t index);

  std::vector<UsbPeer*> peers_;
  UsbPeer* attached_ = nullptr;
  std::vector<std::byte> in_, out_;
  std::deque<Submitted> pending_;
};

}  // namespace telefab::fab
