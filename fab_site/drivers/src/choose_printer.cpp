// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/drivers/choose_printer.hpp>

#include <fmt/format.h>

#include <algorithm>

namespace telefab::fab {

Result<std::unique_ptr<WholePrinter>> chosen_printer(PrinterNetwork& network, Clock& clock,
                                                     const PrinterChoice& choice) {
  SdcpOptions options;
  options.id = choice.id;
  options.question_port = choice.question_port;
  options.connect_timeout = choice.wait;
  if (!choice.address.empty()) {
    auto address = printer_address_from_text(choice.address, kSdcpPort);
    if (!address) return tl::unexpected{address.error()};
    options.address = std::move(*address);
    return make_sdcp_printer(network, clock, std::move(options));
  }
  auto found = find_sdcp_printers(network, "", choice.wait, choice.question_port);
  if (!found) return tl::unexpected{found.error()};
  if (!choice.id.empty()) std::erase_if(*found, [&](const FoundPrinter& p) { return p.id != choice.id; });
  if (found->empty()) return fail(ErrorCode::NotFound, "no printer answers in this network; give its address");
  if (found->size() > 1) {
    std::string list;
    for (const FoundPrinter& p : *found) list += fmt::format("{}{} ({})", list.empty() ? "" : ", ", p.host, p.model);
    return fail(ErrorCode::NotFound,
                fmt::format("{} printers answer: {}; give the address of one", found->size(), list));
  }
  options.address.host = found->front().host;
  options.id = found->front().id;
  return make_sdcp_printer(network, clock, std::move(options));
}

}  // namespace telefab::fab
