// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <cstdint>
#include <random>
#include <string>
#include <thread>

namespace telefab::test {

/// Stands between two sites and cuts every connection after a random number of bytes, so many times; afterwards it
/// only hands on. Closed connections are cut hard (RST), as a failing line does.
class CuttingProxy {
 public:
  CuttingProxy(std::string to_port, std::uint32_t seed, int cuts, std::uint32_t longest_bytes);
  ~CuttingProxy();
  CuttingProxy(const CuttingProxy&) = delete;
  CuttingProxy& operator=(const CuttingProxy&) = delete;
  [[nodiscard]] const std::string& port() const { return port_; }
  [[nodiscard]] int cuts_made() const { return made_; }

 private:
  void run(std::stop_token stop);
  /// Hands bytes on in both directions until `budget` are through, one side closed, or the stop came.
  void hand_on(int near, int far, std::uint64_t budget, const std::stop_token& stop);
  int listener_ = -1;
  std::string to_port_;
  std::string port_;
  std::mt19937 random_;
  int cuts_;
  std::uint32_t longest_bytes_;
  std::atomic<int> made_{0};
  std::jthread thread_;
};

}  // namespace telefab::test
