// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/whole_printer.hpp>
#include <telefab/fab/lan/printer_network.hpp>

namespace telefab::fab {

inline constexpr std::uint16_t kSdcpPort = 3030;
inline constexpr std::uint16_t kSdcpQuestionPort = 3000;

/// A printer that answered the question who is there.
struct FoundPrinter {
  std::string name;
  std::string model;
  std::string brand;
  std::string firmware;
  std::string protocol;  ///< "V3.0.0"
  std::string id;        ///< of its board
  std::string host;      ///< that the answer came from
};

/// Asks who is there, one printer (`host`) or all of the local network (empty), for `wait`. What answers with anything
/// else than the protocol is left out. By host. Fails as PrinterNetwork::ask.
[[nodiscard]] Result<std::vector<FoundPrinter>> find_sdcp_printers(PrinterNetwork& network, std::string_view host,
                                                                   Nanoseconds wait,
                                                                   std::uint16_t port = kSdcpQuestionPort);

struct SdcpOptions {
  PrinterAddress address{{}, kSdcpPort};
  std::string id;  ///< MainboardID; empty: whichever answers there
  std::uint16_t question_port = kSdcpQuestionPort;
  Nanoseconds connect_timeout = std::chrono::seconds{5};
  Nanoseconds answer_timeout = std::chrono::seconds{10};
  Nanoseconds part_timeout = std::chrono::seconds{180};  ///< the last part's reply may wait for the check
};

/// A printer that speaks SDCP v3 (Elegoo's and others with boards by CBD). Connects at the first call, and again after
/// a loss. Both must outlive it.
[[nodiscard]] std::unique_ptr<WholePrinter> make_sdcp_printer(PrinterNetwork& network, Clock& clock,
                                                              SdcpOptions options);

}  // namespace telefab::fab
