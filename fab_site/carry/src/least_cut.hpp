// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>

#include "load_core.hpp"

namespace telefab::fab {

/// A demand as a ratio of whole numbers, kPullUnits of pull over pixels of section, so that flows are exact.
struct Ratio {
  std::int64_t over = 1, under = 1;
  [[nodiscard]] double value() const { return static_cast<double>(over) / static_cast<double>(kPullUnits * under); }
};

/// Pieces that together hang on less than a demand allows: what they are pulled with is more than the demand times the
/// area of the sections that leave them.
struct Hanging {
  std::int64_t pulled = 0;  ///< kPullUnits of a pixel
  std::int64_t cut = 0;     ///< pixels of the sections that leave it
  std::vector<std::uint32_t> nodes;
  std::vector<std::uint32_t> loads;  ///< of the moment, by index
  std::vector<std::uint32_t> edges;  ///< that leave it, by index
  [[nodiscard]] Ratio ratio() const { return {pulled, cut}; }
};

/// Flows through one moment of a print.
class LeastCut {
 public:
  LeastCut(const Moment& moment, const LoadPath& path);
  ~LeastCut();
  LeastCut(const LeastCut&) = delete;
  LeastCut& operator=(const LeastCut&) = delete;
  /// From now on this load is not pulled.
  void release(std::uint32_t load);
  /// What a flow leaves over where every section passes its area times the demand, piece by piece as they hang
  /// together: each bears more than the demand in the mean. None where all flows through.
  [[nodiscard]] std::vector<Hanging> beyond(Ratio demand);

 private:
  struct Network;
  const Moment& moment_;
  const LoadPath& path_;
  std::vector<std::int64_t> pulled_;  ///< by load
  std::unique_ptr<Network> network_;
};

}  // namespace telefab::fab
