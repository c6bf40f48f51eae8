// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>

#include "whole_print_bench.hpp"

namespace telefab::fab {
namespace {

/// The model behind real sockets of this computer.
class SimulatedPrinter {
 public:
  explicit SimulatedPrinter(SdcpFault fault = SdcpFault::None, std::size_t at = 0) {
    options.layer_time = std::chrono::milliseconds{40};
    model = std::make_unique<SdcpModel>(options, clock);
    model->inject(fault, at);
    std::promise<PrinterServerPorts> ready;
    auto taken = ready.get_future();
    thread = std::jthread{[this, &ready](const std::stop_token& stop) {
      const auto ok = serve_printer(
          *model, {}, [&](const PrinterServerPorts& ports_taken) { ready.set_value(ports_taken); }, stop);
      EXPECT_TRUE(ok);
    }};
    ports = taken.get();
  }
  [[nodiscard]] SdcpOptions where() const {
    SdcpOptions o;
    o.address = {"127.0.0.1", ports.port};
    o.question_port = ports.udp_port;
    o.answer_timeout = std::chrono::milliseconds{700};
    return o;
  }
  /// The model is its thread's; joined it is the test's.
  void stop() {
    thread.request_stop();
    thread.join();
  }
  SystemClock clock;
  SdcpModelOptions options;
  std::unique_ptr<SdcpModel> model;
  PrinterServerPorts ports;
  std::jthread thread;
};

Result<WholePrintReport> print_on(SimulatedPrinter& printer, const std::string& bytes, std::string& journal) {
  const auto network = make_printer_network();
  const auto driver = make_sdcp_printer(*network, printer.clock, printer.where());
  auto opened = PrinterJournal::open(memory_journal_file(journal)).value();
  PrintControl control;
  WholePrintPolicy policy;
  policy.poll = std::chrono::milliseconds{50};
  policy.start_wait = std::chrono::seconds{2};
  policy.patience = std::chrono::seconds{10};
  return WholePrintRunner{*driver, opened, printer.clock}.run(test::job_of("part.goo", bytes, printer.options, 5),
                                                              policy, control, {}, {});
}

TEST(PrinterNetwork, FindsAPrinterByItsAnswer) {
  SimulatedPrinter printer;
  const auto network = make_printer_network();
  const auto found = find_sdcp_printers(*network, "127.0.0.1", std::chrono::seconds{5}, printer.ports.udp_port);
  ASSERT_TRUE(found) << found.error().what;
  ASSERT_EQ(found->size(), 1U);
  EXPECT_EQ(found->front().id, printer.options.id);
  EXPECT_EQ(found->front().model, printer.options.model);
  EXPECT_EQ(found->front().host, "127.0.0.1");
  EXPECT_EQ(found->front().protocol, "V3.0.0");
}

TEST(PrinterNetwork, CarriesAWholePrintOverRealSockets) {
  SimulatedPrinter printer;
  const std::string bytes = test::goo_bytes(printer.options, 5);
  std::string journal;
  const auto report = print_on(printer, bytes, journal);
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->outcome, WholePrintOutcome::Done) << report->message;
  printer.stop();
  EXPECT_EQ(printer.model->starts_of("part.goo"), 1U);
  EXPECT_EQ(printer.model->stored("part.goo"), bytes);
  EXPECT_THAT(printer.model->violations(), testing::IsEmpty());
}

TEST(PrinterNetwork, GoesOnBehindLossesOnRealSockets) {
  for (const SdcpFault fault :
       {SdcpFault::LostSocket, SdcpFault::LostAnswer, SdcpFault::NoAnswer, SdcpFault::LostOffset}) {
    SimulatedPrinter printer{fault, 5};
    const std::string bytes = test::goo_bytes(printer.options, 5);
    std::string journal;
    const auto report = print_on(printer, bytes, journal);
    ASSERT_TRUE(report) << report.error().what;
    EXPECT_EQ(report->outcome, WholePrintOutcome::Done) << static_cast<int>(fault) << ": " << report->message;
    printer.stop();
    EXPECT_EQ(printer.model->starts_of("part.goo"), 1U) << static_cast<int>(fault);
  }
}

TEST(PrinterNetwork, NamesAHandshakeThatIsDeclinedAndAnUploadThatIsCut) {
  {
    SimulatedPrinter printer{SdcpFault::TooManyClients, 0};
    const auto network = make_printer_network();
    const auto facts = make_sdcp_printer(*network, printer.clock, printer.where())->facts();
    // The first interaction is the handshake itself: the fault acts behind it, at the first message.
    ASSERT_FALSE(facts);
    const auto again = make_sdcp_printer(*network, printer.clock, printer.where())->facts();
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().code, ErrorCode::DeviceRefused) << again.error().what;
  }
  SimulatedPrinter printer{SdcpFault::CutUpload, 0};
  const auto network = make_printer_network();
  const auto driver = make_sdcp_printer(*network, printer.clock, printer.where());
  const std::string bytes = test::goo_bytes(printer.options, 5);
  const auto job = test::job_of("part.goo", bytes, printer.options, 5);
  ASSERT_TRUE(driver->begin_upload(job.file));
  const auto step = driver->send_part();
  ASSERT_FALSE(step);
  EXPECT_EQ(step.error().code, ErrorCode::DeviceLost) << step.error().what;
}

TEST(PrinterNetwork, NamesAnAddressWhereNobodyListens) {
  const auto network = make_printer_network();
  SystemClock clock;
  std::uint16_t port = 0;
  {
    SimulatedPrinter printer;
    port = printer.ports.port;
  }
  SdcpOptions options;
  options.address = {"127.0.0.1", port};
  options.id = "000000000001d354";
  const auto facts = make_sdcp_printer(*network, clock, options)->facts();
  ASSERT_FALSE(facts);
  EXPECT_EQ(facts.error().code, ErrorCode::Unreachable) << facts.error().what;
}

TEST(PrinterAddress, IsReadFromHostAndPort) {
  EXPECT_EQ(printer_address_from_text("10.0.0.7", 3030).value(), (PrinterAddress{"10.0.0.7", 3030}));
  EXPECT_EQ(printer_address_from_text("printer.lan:99", 3030).value(), (PrinterAddress{"printer.lan", 99}));
  EXPECT_EQ(printer_address_from_text("[fe80::1]:99", 3030).value(), (PrinterAddress{"fe80::1", 99}));
  EXPECT_EQ(printer_address_from_text("fe80::1", 3030).value(), (PrinterAddress{"fe80::1", 3030}));
  for (const char* bad : {"", ":99", "a:0", "a:65536", "a:b", "a b", "[fe80::1", "http://a/b"})
    EXPECT_FALSE(printer_address_from_text(bad, 3030)) << bad;
}

}  // namespace
}  // namespace telefab::fab
