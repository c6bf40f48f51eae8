// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/fab/support/layer_rule.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// A part as the search for supports sees it: every layer, and what of it rests on nothing (4.1).
struct PartRegions {
  SelfSupportLaw law;                        ///< they were analysed by
  std::vector<Region> layers;                ///< simplified, without specks; bottom first
  std::vector<Region> to_support;            ///< by layer; of the first all, as if nothing stood below it
  std::vector<std::vector<Region>> islands;  ///< by layer, as LayerRegions has them
};

/// Analyses whole parts, pairs of layers in parallel; the same on any number of threads.
/// Fails: InvalidInput (coordinates, layer order), Cancelled.
[[nodiscard]] Result<PartRegions> analyse_part(std::span<const Layer> layers, const MachineProfile& machine,
                                               std::stop_token stop);

/// Analyses the layers of a part that come one by one: each pair on a oneTBB thread as soon as both are there, while
/// the next are still on their way. Gives what analyse_part gives.
/// Threads: one caller at a time; add() never waits for the analysis.
class LayerStream {
 public:
  explicit LayerStream(const MachineProfile& machine);
  ~LayerStream();
  LayerStream(const LayerStream&) = delete;
  LayerStream& operator=(const LayerStream&) = delete;

  /// The next layer, bottom first.
  void add(Layer layer);
  /// Waits for what was added. Nothing may be added after it. Fails as analyse_part does.
  [[nodiscard]] Result<PartRegions> finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace telefab::fab
