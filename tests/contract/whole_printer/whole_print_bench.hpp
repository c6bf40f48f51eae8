// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>

#include <telefab/fab/drivers/sdcp_model.hpp>
#include <telefab/fab/drivers/sdcp_printer.hpp>
#include <telefab/fab/print/whole_print_record.hpp>
#include <telefab/fab/print/whole_print_runner.hpp>
#include <thread>

namespace telefab::fab::test {

/// The head of a GOO file as a printer reads it, and filler behind: two parts of an upload.
inline std::string goo_bytes(const SdcpModelOptions& printer, std::uint32_t layers, char filler = 'x') {
  std::string bytes(1'100'000, filler);
  const auto put = [&](std::size_t at, std::size_t size, std::uint32_t value) {
    for (std::size_t i = 0; i < size; ++i) bytes[at + i] = static_cast<char>(value >> 8U * (size - 1 - i));
  };
  bytes.replace(0, 4, "V3.0");
  bytes.replace(92, 32, std::string(32, '\0'));
  bytes.replace(92, printer.model.size(), printer.model);
  put(195'310, 4, layers);
  put(195'314, 2, printer.size.width_px);
  put(195'316, 2, printer.size.height_px);
  return bytes;
}

inline WholePrintJob job_of(const std::string& name, const std::string& bytes, const SdcpModelOptions& printer,
                            std::uint32_t layers) {
  WholePrintJob job;
  job.plan = digest_of(std::as_bytes(std::span{bytes}));
  job.file = {name, bytes.size(), md5_hex(std::as_bytes(std::span{bytes})),
              [&bytes](std::uint64_t offset, std::size_t count) -> Result<std::vector<std::byte>> {
                const auto part = std::as_bytes(std::span{bytes}).subspan(offset, count);
                return std::vector<std::byte>(part.begin(), part.end());
              }};
  job.file_kind = "GOO";
  job.model = printer.model;
  job.size = printer.size;
  job.layers = layers;
  return job;
}

/// A printer on a virtual clock, one file for it, and a journal that outlives every run.
struct WholePrintBench {
  static constexpr std::uint32_t kLayers = 5;
  explicit WholePrintBench(bool has_printed_before = true) {
    if (!has_printed_before) return;
    const std::string earlier = goo_bytes(printer, 2, 'e');
    std::string its_journal;
    const auto done = run_of(job_of("earlier.goo", earlier, printer, 2), its_journal, *network);
    EXPECT_TRUE(done && done->outcome == WholePrintOutcome::Done);
  }
  /// One life of this side: a new driver and runner on the journal there is.
  Result<WholePrintReport> run_of(const WholePrintJob& of, std::string& journal_of, PrinterNetwork& over,
                                  const WholePrintSink& sink = {}, PrintControl* control = nullptr) {
    auto opened = PrinterJournal::open(memory_journal_file(journal_of));
    if (!opened) return tl::unexpected{opened.error()};
    SdcpOptions options;
    options.address.host = "127.0.0.1";
    const auto driver = make_sdcp_printer(over, clock, options);
    PrintControl own;
    WholePrintPolicy policy;
    policy.patience = std::chrono::seconds{60};
    return WholePrintRunner{*driver, *opened, clock}.run(of, policy, control != nullptr ? *control : own, sink, {});
  }
  Result<WholePrintReport> run(const WholePrintSink& sink = {}, PrintControl* control = nullptr) {
    return run_of(job, journal, *network, sink, control);
  }
  /// As an operator who looked at the printer.
  void decide() {
    auto opened = PrinterJournal::open(memory_journal_file(journal)).value();
    const auto decision = model.starts_of("part.goo") > 0 ? StartDecision::TreatAsStarted : StartDecision::StartAgain;
    ASSERT_TRUE(decide_start(opened, decision, "ada", clock.wall()));
  }

  VirtualClock clock;
  SdcpModelOptions printer;
  SdcpModel model{printer, clock};
  std::unique_ptr<PrinterNetwork> network = model_network(model, clock);
  std::string bytes = goo_bytes(printer, kLayers);
  WholePrintJob job = job_of("part.goo", bytes, printer, kLayers);
  std::string journal;
};

}  // namespace telefab::fab::test
