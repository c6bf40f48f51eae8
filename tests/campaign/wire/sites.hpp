// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <sys/types.h>

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace telefab::test {

/// Both daemons as child processes that log into files, in a folder of their own; the fab waits for approval, so that
/// nothing is printed.
class Sites {
 public:
  /// `bin` holds the three programs. A torus of 500 layers on a small machine is the job.
  Sites(std::filesystem::path bin, std::filesystem::path folder);
  ~Sites();
  Sites(const Sites&) = delete;
  Sites& operator=(const Sites&) = delete;

  void start_fab();
  /// `way`: the port where the scan site finds the fab.
  void start_scan(std::uint16_t way);
  void kill_fab() { kill(fab_); }
  void kill_scan() { kill(scan_); }
  [[nodiscard]] std::uint16_t fab_port() const { return fab_port_; }
  /// Another scan instead of the torus.
  void set_scan(std::vector<std::string> submit) { submit_ = std::move(submit); }
  /// The job's id.
  [[nodiscard]] std::string submit() const;
  /// What the scan site says of the job; null where it does not answer.
  [[nodiscard]] nlohmann::json job(const std::string& id) const;
  /// Waits until the fab has the whole stack; false after `patience_s`.
  [[nodiscard]] bool wait_until_kept(const std::string& id, double patience_s) const;
  /// Both sites hold the same chunks, byte for byte.
  [[nodiscard]] bool same_chunks(const std::string& id) const;
  [[nodiscard]] std::filesystem::path folder() const { return folder_; }

 private:
  pid_t start(const std::vector<std::string>& command, const std::string& name, std::uint16_t& port);
  void kill(pid_t& pid);
  [[nodiscard]] std::string client(const std::vector<std::string>& words) const;

  std::filesystem::path bin_;
  std::filesystem::path folder_;
  std::vector<std::string> submit_;
  std::uint16_t fab_port_ = 0;
  std::uint16_t scan_port_ = 0;
  pid_t fab_ = -1;
  pid_t scan_ = -1;
};

}  // namespace telefab::test
