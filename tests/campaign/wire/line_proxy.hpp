// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <thread>

namespace telefab::test {

/// A long line between two sites on one machine. What a lost packet does to a TCP stream is modelled, not made: all
/// bytes behind it come a round trip later (the retransmission), none is lost.
struct Line {
  double one_way_ms = 0;
  double bits_per_s = 0;               ///< 0: no limit
  double loss = 0;                     ///< of packets of 1448 bytes
  int cuts = 0;                        ///< connections cut hard (RST), each after a random number of bytes
  std::uint32_t longest_bytes = 6000;  ///< of a connection that will be cut
  std::uint32_t seed = 1;
};

/// What went over the line, from the scan site's frames and the fab's.
struct LineCount {
  std::uint64_t bytes_up = 0;  ///< scan site to fab
  std::uint64_t bytes_down = 0;
  std::uint64_t chunk_bytes = 0;  ///< of SendChunk frames
  std::uint64_t chunks = 0;
  std::uint64_t chunks_again = 0;  ///< sent before, not acknowledged: lost by a cut
  std::uint64_t kept_again = 0;    ///< sent though the fab had acknowledged them: must stay 0
  int cuts = 0;
  int connections = 0;
};

class LineProxy {
 public:
  LineProxy(std::uint16_t to_port, const Line& line);
  ~LineProxy();
  LineProxy(const LineProxy&) = delete;
  LineProxy& operator=(const LineProxy&) = delete;
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] LineCount count() const;
  void set_target(std::uint16_t to_port) { to_port_ = to_port; }

 private:
  void run(const std::stop_token& stop);
  void hand_on(int near, int far, const std::stop_token& stop);

  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::atomic<std::uint16_t> to_port_;
  Line line_;
  std::mt19937 random_;
  mutable std::mutex mutex_;
  LineCount count_;
  std::map<std::string, std::uint32_t> sent_;  ///< by job: chunks seen
  std::map<std::string, std::uint32_t> kept_;  ///< by job: chunks acknowledged
  std::jthread thread_;
};

}  // namespace telefab::test
