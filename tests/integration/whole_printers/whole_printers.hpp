// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <signal.h>

#include <cstdlib>
#include <regex>
#include <telefab/test/several_machines.hpp>
#include <telefab/test/toy.hpp>

namespace telefab::test {

/// A fab with a printer that owns its light: scan site, fab and a strict simulated printer as real programs.
class WholePrinters : public SeveralMachines {
 protected:
  /// `critical_dose`: in mJ/cm2, of its resin.
  void write_profile(const std::string& critical_dose, double speed_up = 2000) const {
    std::ofstream{folder() / "machines" / "toy.toml"}
        << kToyProfile << "[resin]\ncritical_dose_mj_per_cm2 = " << critical_dose << "\npenetration_mm = 0.3\n"
        << "[motion]\nlift_mm = 2.0\n[devices]\nspeed_up = " << speed_up
        << ".0\n[file]\nkind = \"goo\"\nmodel = \"ELEGOO Toy\"\n";
  }
  void SetUp() override {
    write_profile("4.0");
    look_every = std::chrono::milliseconds{60};
  }
  [[nodiscard]] static std::string bin(const std::string& program) {
    return std::string{std::getenv("TELEFAB_BIN")} + "/" + program;
  }
  /// A printer on a port of its own, the same for every start of it.
  void start_printer(const std::string& layer_s = "0.1", const std::string& model = "ELEGOO Toy",
                     const std::vector<std::string>& more = {}) {
    std::filesystem::create_directories(folder() / "printer");
    std::ofstream{folder() / "printer" / "toy.toml"} << kToyProfile << "[file]\nkind = \"goo\"\nmodel = \"" << model
                                                     << "\"\n";
    std::vector<std::string> words{bin("telefab-fab"), "simulate-printer",
                                   "--machine",        "toy",
                                   "--machines",       (folder() / "printer").string(),
                                   "--port",           port_,
                                   "--question-port",  "0",
                                   "--layer-s",        layer_s};
    words.insert(words.end(), more.begin(), more.end());
    printer_ = std::make_unique<Process>(words);
    const std::string line = printer_->read_line();
    static const std::regex ports{R"(.* on 127\.0\.0\.1:(\d+), asked who is there at UDP (\d+))"};
    std::smatch found;
    ASSERT_TRUE(std::regex_match(line, found, ports)) << line;
    port_ = found[1];
    question_port_ = found[2];
  }
  void write_whole_list(const std::vector<std::string>& own_light = {}, const std::string& more = {}) {
    std::vector<std::string> names{"saturn"};
    names.insert(names.end(), own_light.begin(), own_light.end());
    write_list(names, {{"saturn", fmt::format("{}[machine.devices]\nprinter = \"sdcp\"\nprinter_address = "
                                              "\"127.0.0.1:{}\"\nprinter_id = \"000000000001d354\"",
                                              more, port_)}});
  }
  /// What the printer counted, once it has ended.
  std::string end_of_printer() {
    printer_->send_signal(SIGTERM);
    EXPECT_EQ(printer_->finish(), 0);
    return printer_->output();
  }
  /// Prints begun by it, once it has ended.
  int starts_at_end() {
    const std::string counted = end_of_printer();
    EXPECT_THAT(counted, testing::HasSubstr("messages against the protocol: 0"));
    const std::size_t at = counted.find("prints begun: ");
    return at == std::string::npos ? -1 : std::atoi(counted.c_str() + at + 14);
  }
  void expect_once() {
    EXPECT_THAT(end_of_printer(), testing::HasSubstr("prints begun: 1, messages against the protocol: 0"));
  }
  [[nodiscard]] std::string journal_of(const std::string& job) const {
    const std::filesystem::path path = job_folder(job) / "printer.journal";
    return std::filesystem::exists(path) ? text_of(path) : std::string{};
  }
  [[nodiscard]] std::string last_step(const std::string& job) const {
    const std::string text = journal_of(job);
    const std::size_t at = text.rfind("\"step\":\"");
    return at == std::string::npos ? "" : text.substr(at + 8, text.find('"', at + 8) - at - 8);
  }
  [[nodiscard]] bool has_step(const std::string& job, const std::string& step) const {
    return journal_of(job).find("\"step\":\"" + step + "\"") != std::string::npos;
  }
  void await_state(const std::string& job, const std::string& state, int seconds = 60) const {
    ASSERT_TRUE(await([&] { return job_state(job) == state; }, seconds)) << "not " << state << "\n" << says();
  }
  [[nodiscard]] std::string message_of(const std::string& job) const {
    const Json found = job_of(job);
    return found.is_object() ? found["message"].get<std::string>() : std::string{};
  }
  [[nodiscard]] bool prints_layers(const std::string& job) const {
    const Json found = job_of(job);
    return found.is_object() && found["layers_printed"] > 1;
  }

  /// A job whose print at the printer is amid its layers, each of which takes so long.
  [[nodiscard]] std::string print_begun(const std::string& layer_s, const std::vector<std::string>& asked = {}) {
    start_printer(layer_s);
    write_whole_list();
    start_sites();
    std::string job = submit_for("toy", "4", asked);
    EXPECT_TRUE(await([&] { return prints_layers(job); })) << says();
    return job;
  }
  /// It is watched again, and a cancel stops it at the printer.
  void expect_stopped_by_cancel(const std::string& job) {
    await_state(job, "printing");
    ASSERT_EQ(at_fab({"cancel", job, "--who", "ana"}).code, 0) << says();
    await_state(job, "cancelled");
    EXPECT_EQ(record_of(job)["end"], "stopped");
    expect_once();
  }

  /// Goes on with a paused job as somebody does who has looked at the printer.
  void look_and_resume(const std::string& job) const {
    std::vector<std::string> words{"resume", job, "--who", "ana"};
    if (message_of(job).find("treat-as-started") != std::string::npos) {
      const Outcome asked = run({bin("telefab-fab"), "printers", "--address", "127.0.0.1:" + port_, "--question-port",
                                 question_port_, "--json"});
      EXPECT_EQ(asked.code, 0) << asked.errors;
      const Json printer = Json::parse(asked.output, nullptr, false);
      const bool has_it = printer.is_object() && printer["task"]["file"].get<std::string>().starts_with(job);
      words.insert(words.end(), {"--as", has_it ? "treat-as-started" : "start-again"});
    }
    (void)at_fab(words);  // where it goes on by itself meanwhile that is as good
  }

  std::string port_ = "0", question_port_;
  std::unique_ptr<Process> printer_;
};

}  // namespace telefab::test
