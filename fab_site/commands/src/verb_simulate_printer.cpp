// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/drivers/sdcp_model.hpp>

#include "verbs.hpp"

namespace telefab::fab {

VerbBody declare_simulate_printer(VerbOptions& options) {
  struct Options {
    std::string address = "127.0.0.1";
    std::uint16_t port = 3030;
    std::uint16_t question_port = 3000;
    double layer_s = 0.2;
    std::string fault;
    std::string moment = "start";
    MachineChoice machine;
  };
  auto o = std::make_shared<Options>();
  options.add("--address", o->address, "where to listen; anybody who can connect can print").shows_default();
  options.add("--port", o->port, "of WebSocket and uploads; 0: any free one").shows_default();
  options.add("--question-port", o->question_port, "UDP port of the question who is there; 0: any free one")
      .shows_default();
  options.add("--layer-s", o->layer_s, "seconds a layer takes").shows_default().within(0.01, 600.0);
  std::vector<std::string> faults;
  for (std::size_t i = 1; i < kSdcpFaults; ++i) faults.emplace_back(name_of(static_cast<SdcpFault>(i)));
  options.add("--fault", o->fault, "what goes wrong at it, to see what the fab makes of that; default: nothing")
      .one_of(faults);
  options.add("--fault-at", o->moment, "when: upload | start | watch, with the first such message")
      .one_of({"upload", "start", "watch"})
      .shows_default();
  declare_machine_choice(options, o->machine, "profile whose pixels and file.model it has", MachineIs::Required);
  return [o](std::stop_token stop) -> Result<ExitCode> {
    const auto machine = chosen_machine(o->machine);
    if (!machine) return tl::unexpected{machine.error()};
    SdcpModelOptions printer;
    printer.name = "simulated " + machine->name;
    printer.model = machine->file.model.empty() ? machine->name : machine->file.model;
    printer.size = machine->mask_size();
    printer.layer_time = Nanoseconds{static_cast<Nanoseconds::rep>(o->layer_s * 1e9)};
    SystemClock clock;
    SdcpModel model{printer, clock};
    if (const auto fault = sdcp_fault_from_name(o->fault))
      model.inject_when(*fault, o->moment == "upload"  ? SdcpMoment::Upload
                                : o->moment == "watch" ? SdcpMoment::Watch
                                                       : SdcpMoment::Start);
    const auto served = serve_printer(
        model, {o->address, o->port, o->question_port},
        [&](const PrinterServerPorts& taken) {
          write_output(fmt::format("simulated {} on {}:{}, asked who is there at UDP {}\n", printer.model,
                                   taken.address, taken.port, taken.udp_port));
          (void)flush_output();  // whoever waits for this line; run_program reports a failure
        },
        stop);
    if (!served) return tl::unexpected{served.error()};
    write_output(fmt::format("prints begun: {}, messages against the protocol: {}\n", model.starts(),
                             model.violations().size()));
    return ExitCode::Ok;
  };
}

}  // namespace telefab::fab
