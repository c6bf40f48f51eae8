// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/drivers/choose_printer.hpp>

#include "verbs.hpp"

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

struct Options {
  std::string address;
  std::string order;
  double wait_s = 3;
  std::uint16_t question_port = kSdcpQuestionPort;
  bool is_json = false;
};

Nanoseconds wait_of(const Options& o) { return Nanoseconds{static_cast<Nanoseconds::rep>(o.wait_s * 1e9)}; }

Result<ExitCode> list(PrinterNetwork& network, const Options& o) {
  const auto found = find_sdcp_printers(network, "", wait_of(o), o.question_port);
  if (!found) return tl::unexpected{found.error()};
  Json all = Json::array();
  for (const FoundPrinter& p : *found) {
    all.push_back({{"address", p.host},
                   {"name", p.name},
                   {"model", p.model},
                   {"brand", p.brand},
                   {"id", p.id},
                   {"firmware", p.firmware},
                   {"protocol", p.protocol}});
    if (!o.is_json)
      write_output(fmt::format("{:<16} {:<28} {:<20} {} firmware {}\n", p.host, p.model, p.name, p.id, p.firmware));
  }
  if (o.is_json) write_output(json_text(all, 2) + "\n");
  if (found->empty() && !o.is_json)
    write_note("telefab-fab: no printer answers in this network; ask one by --address\n");
  return ExitCode::Ok;
}

void print_printer(const WholePrinterFacts& f, const WholePrinterStatus& s, bool is_json) {
  const PrinterTask& t = s.task;
  const char* does = s.activity.prints     ? "prints"
                     : s.activity.receives ? "receives a file"
                     : s.activity.tests    ? "tests itself"
                                           : "idle";
  if (is_json) {
    Json json{{"address", f.address},
              {"name", f.name},
              {"model", f.model},
              {"id", f.id},
              {"firmware", f.firmware},
              {"width_px", f.size.width_px},
              {"height_px", f.size.height_px},
              {"file_kinds", f.file_kinds},
              {"prints", s.activity.prints},
              {"receives", s.activity.receives},
              {"tests", s.activity.tests},
              {"task",
               {{"id", t.id},
                {"file", t.file},
                {"state", name_of(t.state)},
                {"layer", t.layer},
                {"layers", t.layers},
                {"elapsed_ms", t.elapsed.count()},
                {"estimated_ms", t.estimated.count()},
                {"problem", name_of(t.problem)}}}};
    if (f.free_bytes) json["free_bytes"] = *f.free_bytes;
    write_output(json_text(json, 2) + "\n");
    return;
  }
  write_output(fmt::format("{} ({}), firmware {}, board {}\n  panel {} x {} pixels, takes {}{}\n  {}\n", f.model,
                           f.name, f.firmware, f.id, f.size.width_px, f.size.height_px, fmt::join(f.file_kinds, ", "),
                           f.free_bytes ? fmt::format(", {:.1f} MB free", double(*f.free_bytes) / 1e6) : "", does));
  if (!t.file.empty())
    write_output(fmt::format("  {}: {}, layer {} of {}\n", t.file, name_of(t.state), t.layer, t.layers));
  if (t.problem != PrinterProblem::None)
    write_output(fmt::format("  {}: {}\n", name_of(t.problem), advice_on(t.problem)));
}

Result<ExitCode> ask_one(PrinterNetwork& network, const Options& o) {
  SystemClock clock;
  const auto printer = chosen_printer(network, clock, {o.address, {}, o.question_port, wait_of(o)});
  if (!printer) return tl::unexpected{printer.error()};
  if (!o.order.empty()) {
    const auto answer = o.order == "pause"    ? (*printer)->pause()
                        : o.order == "resume" ? (*printer)->resume()
                                              : (*printer)->stop();
    if (!answer) return tl::unexpected{answer.error()};
    if (*answer != PrinterProblem::None)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("the printer refuses: {}: {}", name_of(*answer), advice_on(*answer)));
  }
  const auto facts = (*printer)->facts();
  if (!facts) return tl::unexpected{facts.error()};
  const auto status = (*printer)->status();
  if (!status) return tl::unexpected{status.error()};
  print_printer(*facts, *status, o.is_json);
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_printers(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("--address", o->address, "one printer, HOST or HOST:PORT: what it is and what it does");
  options
      .add("--order", o->order,
           "to the print under way at --address. The printer owns its light: stop is the way to end it")
      .one_of({"pause", "resume", "stop"});
  options.add("--wait-s", o->wait_s, "seconds to wait for answers").shows_default().within(0.1, 60.0);
  options.add("--question-port", o->question_port, "UDP port of the question who is there").shows_default();
  options.flag("--json", o->is_json, "as JSON");
  options.footer(
      "Lists printers that speak SDCP v3 (Elegoo's and others with boards by CBD). They ask for no password: whoever "
      "is in\n"
      "the network may start and stop their prints.");
  return [o](std::stop_token) -> Result<ExitCode> {
    if (!o->order.empty() && o->address.empty())
      return fail(ErrorCode::InvalidInput, "--order goes to one printer; give its --address");
    const auto network = make_printer_network();
    return o->address.empty() ? list(*network, *o) : ask_one(*network, *o);
  };
}

}  // namespace telefab::fab
