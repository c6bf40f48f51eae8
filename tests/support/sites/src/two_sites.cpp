// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <stdlib.h>

#include <algorithm>
#include <fstream>
#include <telefab/test/toy.hpp>
#include <telefab/test/two_sites.hpp>

namespace telefab::test {

TwoSites::TwoSites() : bin_{::getenv("TELEFAB_BIN") ? ::getenv("TELEFAB_BIN") : "."} {
  std::filesystem::create_directories(folder_ / "machines");
  set_machine(5000);
  write_torus(torus(), 90, 36);
}

TwoSites::~TwoSites() {
  scan_.reset();
  fab_.reset();
  // The process that computes the accuracy outlives a fab that was killed, and may still write here.
  std::error_code error;
  for (int tries = 0; tries < 200; ++tries) {
    std::filesystem::remove_all(folder_, error);
    if (!error) break;
    ::poll(nullptr, 0, 50);
  }
  EXPECT_FALSE(error) << folder_ << ": " << error.message();
}

std::filesystem::path TwoSites::torus() const { return folder_ / "torus.xyz"; }

void TwoSites::set_machine(double speed_up) const {
  std::ofstream{folder_ / "machines" / "toy.toml"} << kToyProfile
                                                   << fmt::format(R"([resin]
critical_dose_mj_per_cm2 = 4.0
penetration_mm = 0.3
[devices]
speed_up = {:.1f}
)",
                                                                  speed_up);
}

void TwoSites::start_fab(const std::vector<std::string>& more) {
  std::vector<std::string> command{bin_ + "/telefab-fab",
                                   "serve",
                                   "--listen",
                                   fab_site(),
                                   "--data",
                                   (folder_ / "fab").string(),
                                   "--machines",
                                   (folder_ / "machines").string()};
  command.insert(command.end(), more.begin(), more.end());
  fab_ = std::make_unique<Process>(command);
  fab_port_ = fab_->read_line();
  ASSERT_FALSE(fab_port_.empty()) << fab_->errors();
}

void TwoSites::start_scan(const std::vector<std::string>& more) {
  std::vector<std::string> command{bin_ + "/telefab-scan",
                                   "serve",
                                   "--listen",
                                   scan_site(),
                                   "--fab",
                                   way_to_fab_.empty() ? fab_site() : way_to_fab_,
                                   "--data",
                                   (folder_ / "scan").string(),
                                   "--machines",
                                   (folder_ / "machines").string()};
  command.insert(command.end(), more.begin(), more.end());
  scan_ = std::make_unique<Process>(command);
  scan_port_ = scan_->read_line();
  ASSERT_FALSE(scan_port_.empty()) << scan_->errors();
}

std::unique_ptr<Process> TwoSites::telefab_begun(std::vector<std::string> arguments) const {
  arguments.insert(arguments.begin(), bin_ + "/telefab");
  if (std::find(arguments.begin(), arguments.end(), "--site") == arguments.end())
    arguments.insert(arguments.end(), {"--site", scan_site()});
  return std::make_unique<Process>(arguments);
}

Outcome TwoSites::telefab(std::vector<std::string> arguments) const {
  const auto process = telefab_begun(std::move(arguments));
  const int code = process->finish();
  return {code, process->output(), process->errors()};
}

std::string TwoSites::submit_torus() const {
  const Outcome outcome = telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4"});
  EXPECT_EQ(outcome.code, 0) << outcome.errors;
  return outcome.output.substr(0, outcome.output.find('\n'));
}

std::string TwoSites::text_of(const std::filesystem::path& file) const {
  std::ifstream in{file, std::ios::binary};
  return {std::istreambuf_iterator<char>{in}, {}};
}

}  // namespace telefab::test
