// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/drivers/choose_printer.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace telefab::fab {
namespace {

/// Where the printer of a choice is. Fails as chosen_printer.
Result<SdcpOptions> options_of(PrinterNetwork& network, const PrinterChoice& choice) {
  SdcpOptions options;
  options.id = choice.id;
  options.question_port = choice.question_port;
  options.connect_timeout = choice.wait;
  if (!choice.address.empty()) {
    auto address = printer_address_from_text(choice.address, kSdcpPort);
    if (!address) return tl::unexpected{address.error()};
    options.address = std::move(*address);
    return options;
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
  return options;
}

class SoughtPrinter final : public WholePrinter {
 public:
  SoughtPrinter(PrinterNetwork& network, Clock& clock, PrinterChoice choice)
      : network_{network}, clock_{clock}, choice_{std::move(choice)} {}

  Result<WholePrinterFacts> facts() override {
    return ask([](WholePrinter& printer) { return printer.facts(); });
  }
  Result<WholePrinterStatus> status() override {
    return ask([](WholePrinter& printer) { return printer.status(); });
  }
  Result<std::optional<PrinterTask>> task(std::string_view id) override {
    return ask([&](WholePrinter& printer) { return printer.task(id); });
  }
  Result<void> begin_upload(const PrinterUpload& file) override {
    return ask([&](WholePrinter& printer) { return printer.begin_upload(file); });
  }
  Result<UploadStep> send_part() override {
    return ask([](WholePrinter& printer) { return printer.send_part(); });
  }
  Result<void> end_upload() override { return found_ ? found_->end_upload() : Result<void>{}; }
  Result<PrinterProblem> start(std::string_view file) override {
    return ask([&](WholePrinter& printer) { return printer.start(file); });
  }
  Result<PrinterProblem> pause() override {
    return ask([](WholePrinter& printer) { return printer.pause(); });
  }
  Result<PrinterProblem> resume() override {
    return ask([](WholePrinter& printer) { return printer.resume(); });
  }
  Result<PrinterProblem> stop() override {
    return ask([](WholePrinter& printer) { return printer.stop(); });
  }

 private:
  template <class Question>
  auto ask(const Question& question) -> decltype(question(std::declval<WholePrinter&>())) {
    if (!found_) {
      auto options = options_of(network_, choice_);
      if (!options)
        return fail(options.error().code == ErrorCode::NotFound ? ErrorCode::Unreachable : options.error().code,
                    options.error().what);
      choice_.id = options->id;  // from now on it is this one
      found_ = make_sdcp_printer(network_, clock_, std::move(*options));
    }
    auto answer = question(*found_);
    // It may have another address by now. One whose name is not known might turn out to be another printer.
    if (!answer && answer.error().code == ErrorCode::Unreachable && !choice_.id.empty()) found_.reset();
    return answer;
  }

  PrinterNetwork& network_;
  Clock& clock_;
  PrinterChoice choice_;
  std::unique_ptr<WholePrinter> found_;
};

}  // namespace

std::unique_ptr<WholePrinter> sought_printer(PrinterNetwork& network, Clock& clock, PrinterChoice choice) {
  return std::make_unique<SoughtPrinter>(network, clock, std::move(choice));
}

Result<std::unique_ptr<WholePrinter>> chosen_printer(PrinterNetwork& network, Clock& clock,
                                                     const PrinterChoice& choice) {
  auto options = options_of(network, choice);
  if (!options) return tl::unexpected{options.error()};
  return make_sdcp_printer(network, clock, std::move(*options));
}

}  // namespace telefab::fab
