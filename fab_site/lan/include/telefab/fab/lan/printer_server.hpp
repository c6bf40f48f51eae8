// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <stop_token>
#include <telefab/fab/lan/printer_network.hpp>

namespace telefab::fab {

/// What a simulated printer does with one message of a client.
struct PeerAnswer {
  std::vector<std::string> messages;  ///< to that client
  bool hangs_up = false;              ///< behind them
};

/// A simulated printer on bytes. Called from the server's thread only.
class PrinterPeer {
 public:
  virtual ~PrinterPeer() = default;
  PrinterPeer(const PrinterPeer&) = delete;
  PrinterPeer& operator=(const PrinterPeer&) = delete;
  /// Nothing: it keeps silent.
  [[nodiscard]] virtual std::optional<std::string> on_datagram(std::string_view text) = 0;
  /// Whether one client more than `clients` is let in.
  [[nodiscard]] virtual bool lets_in(std::size_t clients) = 0;
  [[nodiscard]] virtual PeerAnswer on_message(std::string_view text) = 0;
  /// Nothing: it hangs up without a reply.
  [[nodiscard]] virtual std::optional<HttpReply> on_post(std::string_view path, std::string_view content_type,
                                                         std::string_view body) = 0;
  /// What it has for all clients by now.
  [[nodiscard]] virtual std::vector<std::string> pushed() = 0;

 protected:
  PrinterPeer() = default;
};

struct PrinterServerPorts {
  std::string address = "127.0.0.1";
  std::uint16_t port = 0;      ///< of WebSocket and HTTP; 0: any free one
  std::uint16_t udp_port = 0;  ///< 0: any free one
};

/// Serves a simulated printer until asked to stop. `on_ready` gets the ports that were taken. Unreachable: it cannot
/// listen there.
[[nodiscard]] Result<void> serve_printer(PrinterPeer& peer, const PrinterServerPorts& ports,
                                         const std::function<void(const PrinterServerPorts&)>& on_ready,
                                         std::stop_token stop);

}  // namespace telefab::fab
