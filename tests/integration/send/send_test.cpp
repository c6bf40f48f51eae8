// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <telefab/base/exit_code.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/test/toy.hpp>

namespace telefab::test {
namespace {

using testing::HasSubstr;
using Words = std::vector<std::string>;

class Send : public testing::Test {
 protected:
  void SetUp() override {
    setenv("XDG_CONFIG_HOME", (folder_.path() / "config").c_str(), 1);
    write_profile("machines", "ELEGOO Toy");
    write_torus(folder_.path() / "torus.xyz", 180, 72);
    ASSERT_EQ(run({bin("telefab-scan"), "slice", at("torus.xyz"), "--machine", "toy", "--machines", at("machines"),
                   "--height-mm", "4", "--out", at("torus.tfc")})
                  .code,
              0);
    const Outcome planned =
        run({bin("telefab-fab"), "plan", at("torus.tfc"), "--machines", at("machines"), "--out", at("plan")});
    ASSERT_EQ(planned.code, 0) << planned.errors;
    printer_ =
        std::make_unique<Process>(Words{bin("telefab-fab"), "simulate-printer", "--machine", "toy", "--machines",
                                        at("machines"), "--port", "0", "--question-port", "0", "--layer-s", "0.1"});
    const std::string line = printer_->read_line();
    static const std::regex ports{R"(.* on (127\.0\.0\.1:\d+), asked who is there at UDP (\d+))"};
    std::smatch found;
    ASSERT_TRUE(std::regex_match(line, found, ports)) << line;
    address_ = found[1];
    question_port_ = found[2];
  }
  void write_profile(const char* name, const char* model) {
    std::filesystem::create_directories(folder_.path() / name);
    std::ofstream{folder_.path() / name / "toy.toml"}
        << kToyProfile << "[resin]\ncritical_dose_mj_per_cm2 = 4.0\npenetration_mm = 0.3\n"
        << "[file]\nkind = \"goo\"\nmodel = \"" << model << "\"\n";
  }
  static std::string bin(const std::string& program) { return std::string{::getenv("TELEFAB_BIN")} + "/" + program; }
  [[nodiscard]] std::string at(const char* name) const { return (folder_.path() / name).string(); }
  [[nodiscard]] Words words(Words more = {}, const char* machines = "machines") const {
    Words all{bin("telefab-fab"), "send",        at("plan"), "--machines", at(machines), "--to", address_,
              "--question-port",  question_port_};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  /// What the printer counted, once it has ended.
  std::string end_of_printer() {
    printer_->send_signal(SIGTERM);
    EXPECT_EQ(printer_->finish(), 0);
    return printer_->output();
  }
  ScratchFolder folder_;
  std::unique_ptr<Process> printer_;
  std::string address_, question_port_;
};

TEST_F(Send, GivesAPlanToAPrinterStartsItWhenAskedAndOnce) {
  const Outcome sent = run(words());
  ASSERT_EQ(sent.code, 0) << sent.errors;
  EXPECT_THAT(sent.output, HasSubstr("nothing was started"));
  const Outcome printed = run(words({"--start", "--json"}));
  ASSERT_EQ(printed.code, 0) << printed.errors << printed.output;
  const std::string last = printed.output.substr(printed.output.rfind('\n', printed.output.size() - 2) + 1);
  EXPECT_EQ(nlohmann::json::parse(last).at("outcome"), "done") << last;
  EXPECT_THAT(printed.output, HasSubstr("\"phase\":\"printing\""));
  std::ifstream record{at("plan.sent") + "/record.json"};
  const auto recorded = nlohmann::json::parse(record);
  EXPECT_EQ(recorded.at("light"), "by the printer");
  EXPECT_EQ(recorded.at("end"), "done");
  EXPECT_EQ(run(words({"--start"})).code, 0) << "it is known to be done";
  const Outcome asked =
      run({bin("telefab-fab"), "printers", "--address", address_, "--question-port", question_port_, "--json"});
  ASSERT_EQ(asked.code, 0) << asked.errors;
  const auto json = nlohmann::json::parse(asked.output);
  EXPECT_EQ(json.at("model"), "ELEGOO Toy");
  EXPECT_EQ(json.at("task").at("state"), "complete");
  const Outcome second = run(words({"--start", "--again"}));
  EXPECT_EQ(second.code, 0) << second.errors;
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 2, messages against the protocol: 0"));
}

TEST_F(Send, KilledInTheMiddleWatchesOnAndStartsNothingAgain) {
  {
    Process first{words({"--start", "--json"})};
    while (true) {
      const std::string line = first.read_line();
      ASSERT_FALSE(line.empty()) << first.errors();
      if (line.find("printing") != std::string::npos) break;
    }
    first.send_signal(SIGKILL);
    EXPECT_EQ(first.finish(), -SIGKILL);
  }
  EXPECT_EQ(run(words({"--start", "--again"})).code, static_cast<int>(ExitCode::Refused)) << "it is not over";
  const Outcome again = run(words({"--start", "--json"}));
  EXPECT_EQ(again.code, 0) << again.errors << again.output;
  EXPECT_THAT(again.output, HasSubstr("\"outcome\":\"done\""));
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 1, messages against the protocol: 0"));
}

TEST_F(Send, StoppedByAWordEndsAsStopped) {
  Process first{words({"--start", "--json"})};
  while (true) {
    const std::string line = first.read_line();
    ASSERT_FALSE(line.empty()) << first.errors();
    if (line.find("printing") != std::string::npos) break;
  }
  const Outcome stop = run(
      {bin("telefab-fab"), "printers", "--address", address_, "--question-port", question_port_, "--order", "stop"});
  EXPECT_EQ(stop.code, 0) << stop.errors;
  EXPECT_EQ(first.finish(), static_cast<int>(ExitCode::JobFailed));
  EXPECT_THAT(first.output(), HasSubstr("\"outcome\":\"stopped\""));
}

TEST_F(Send, RefusesAPrinterOfAnotherModelByName) {
  write_profile("others", "ELEGOO Other");
  const Outcome refused = run(words({"--start"}, "others"));
  EXPECT_EQ(refused.code, static_cast<int>(ExitCode::Device)) << refused.errors;
  EXPECT_THAT(refused.errors, HasSubstr("file.model"));
  EXPECT_THAT(end_of_printer(), HasSubstr("prints begun: 0"));
}

}  // namespace
}  // namespace telefab::test
