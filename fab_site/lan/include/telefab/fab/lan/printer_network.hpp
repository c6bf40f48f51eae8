// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab {

/// Where a printer listens.
struct PrinterAddress {
  std::string host;  ///< IP address or name
  std::uint16_t port = 0;
  friend bool operator==(const PrinterAddress&, const PrinterAddress&) = default;
};
/// "HOST", "HOST:PORT" or "[IPV6]:PORT". InvalidInput says what is wrong.
[[nodiscard]] Result<PrinterAddress> printer_address_from_text(std::string_view text, std::uint16_t port_otherwise);
[[nodiscard]] std::string to_text(const PrinterAddress& address);

struct Datagram {
  std::string host;  ///< of the sender
  std::string text;
};
struct HttpReply {
  unsigned status = 0;
  std::string body;
};

/// One WebSocket of text messages. Threads: one caller at a time.
class MessageSocket {
 public:
  virtual ~MessageSocket() = default;
  MessageSocket(const MessageSocket&) = delete;
  MessageSocket& operator=(const MessageSocket&) = delete;
  /// DeviceTimeout, DeviceLost: the socket is closed then.
  [[nodiscard]] virtual Result<void> send(std::string_view text, Nanoseconds timeout) = 0;
  /// Nothing: no message came in that time. DeviceLost (closed), ProtocolBroken (above 1 MiB).
  [[nodiscard]] virtual Result<std::optional<std::string>> receive(Nanoseconds timeout) = 0;

 protected:
  MessageSocket() = default;
};

/// Bytes to and from printers of the local network: the only place that knows sockets. Every call is bounded in time.
/// Threads: one caller at a time.
class PrinterNetwork {
 public:
  virtual ~PrinterNetwork() = default;
  PrinterNetwork(const PrinterNetwork&) = delete;
  PrinterNetwork& operator=(const PrinterNetwork&) = delete;
  /// Sends a datagram to `host` and waits for a reply at most so long, or as broadcast where `host` is empty, and
  /// gathers what comes back in all of that time. Unreachable: no network.
  [[nodiscard]] virtual Result<std::vector<Datagram>> ask(std::string_view host, std::uint16_t port,
                                                          std::string_view text, Nanoseconds wait) = 0;
  /// Unreachable (nobody listens, no such name), DeviceRefused (the handshake was declined), DeviceTimeout.
  [[nodiscard]] virtual Result<std::unique_ptr<MessageSocket>> connect(const PrinterAddress& where,
                                                                       std::string_view path, Nanoseconds timeout) = 0;
  /// Any status is a reply. Unreachable, DeviceLost (cut before the reply), DeviceTimeout, ProtocolBroken.
  [[nodiscard]] virtual Result<HttpReply> post(const PrinterAddress& where, std::string_view path,
                                               std::string_view content_type, std::string body,
                                               Nanoseconds timeout) = 0;

 protected:
  PrinterNetwork() = default;
};

[[nodiscard]] std::unique_ptr<PrinterNetwork> make_printer_network();

}  // namespace telefab::fab
