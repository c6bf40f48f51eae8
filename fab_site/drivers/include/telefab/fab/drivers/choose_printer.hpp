// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/fab/drivers/sdcp_printer.hpp>

namespace telefab::fab {

/// Where a printer is looked for.
struct PrinterChoice {
  std::string address;  ///< "HOST" or "HOST:PORT"; empty: by broadcast, where just one answers
  std::string id;       ///< of its board; empty: any
  std::uint16_t question_port = kSdcpQuestionPort;
  Nanoseconds wait = std::chrono::seconds{3};  ///< for its first answer
};

/// The printer of that choice. Fails: InvalidInput (address), NotFound (none answers, or several: they are listed),
/// Unreachable. Network and clock must outlive it.
[[nodiscard]] Result<std::unique_ptr<WholePrinter>> chosen_printer(PrinterNetwork& network, Clock& clock,
                                                                   const PrinterChoice& choice);

/// A printer that is looked for when it is asked something and is not known, and where one whose id is stated does not
/// answer any more where it was; it is never another one than before. While it is not found its calls fail:
/// Unreachable, InvalidInput (address). Network and clock must outlive it.
[[nodiscard]] std::unique_ptr<WholePrinter> sought_printer(PrinterNetwork& network, Clock& clock, PrinterChoice choice);

}  // namespace telefab::fab
