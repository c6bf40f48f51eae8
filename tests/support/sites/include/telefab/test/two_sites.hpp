// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab::test {

/// Both daemons as real processes on loopback, ports chosen by the system, virtual devices; and the client.
class TwoSites : public testing::Test {
 protected:
  TwoSites();
  ~TwoSites() override;

  /// A small, quick machine named "toy": 20 x 20 mm at 0.1 mm, 0.2 mm layers, simulated seconds per second as given.
  void set_machine(double speed_up) const;
  /// The port is chosen at the first start and kept for later ones.
  void start_fab(const std::vector<std::string>& more = {});
  void start_scan(const std::vector<std::string>& more = {});
  void start_both() {
    start_fab();
    start_scan();
  }
  void kill_fab() { fab_.reset(); }
  void kill_scan() { scan_.reset(); }
  [[nodiscard]] Process& fab() { return *fab_; }
  [[nodiscard]] Process& scan() { return *scan_; }
  [[nodiscard]] std::string fab_site() const { return "127.0.0.1:" + fab_port_; }
  [[nodiscard]] std::string scan_site() const { return "127.0.0.1:" + scan_port_; }
  /// Where the scan site looks for the fab, when something stands between them.
  void set_way_to_fab(const std::string& site) { way_to_fab_ = site; }
  [[nodiscard]] const std::string& fab_port() const { return fab_port_; }
  [[nodiscard]] const std::string& scan_port() const { return scan_port_; }

  /// telefab VERB ARGUMENTS --site SCAN SITE
  [[nodiscard]] Outcome telefab(std::vector<std::string> arguments) const;
  [[nodiscard]] std::unique_ptr<Process> telefab_begun(std::vector<std::string> arguments) const;
  /// Submits a sampled torus; the job's id.
  [[nodiscard]] std::string submit_torus() const;
  [[nodiscard]] std::filesystem::path torus() const;
  [[nodiscard]] std::filesystem::path folder() const { return folder_; }
  [[nodiscard]] std::string text_of(const std::filesystem::path& file) const;

 private:
  ScratchFolder scratch_;
  std::filesystem::path folder_ = scratch_.path();
  std::string bin_;
  std::string fab_port_ = "0";
  std::string scan_port_ = "0";
  std::string way_to_fab_;
  std::unique_ptr<Process> fab_;
  std::unique_ptr<Process> scan_;
};

}  // namespace telefab::test
