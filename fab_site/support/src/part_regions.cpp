// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_group.h>

#include <deque>
#include <mutex>
#include <optional>
#include <telefab/fab/support/part_regions.hpp>

namespace telefab::fab {
namespace {

/// One layer as the rule reads it; `k` is the place it stands in.
Result<Region> read_layer(const Layer& layer, std::size_t k, const MachineProfile& machine) {
  if (layer.index.count() != k)
    return fail(ErrorCode::InvalidInput,
                fmt::format("planning supports: layer {} stands in the place of layer {}", layer.index.count(), k));
  auto region = Region::from_contours(layer.contours);
  if (!region)
    return fail(ErrorCode::InvalidInput, fmt::format("planning supports: layer {}: {}", k, region.error().what));
  return simplified(*region, Millimetres{machine.projection.pixel_pitch_mm / 10});
}

}  // namespace

Result<PartRegions> analyse_part(std::span<const Layer> layers, const MachineProfile& machine, std::stop_token stop) {
  PartRegions part;
  part.law = self_support_law(machine);
  std::vector<Region> regions(layers.size());
  std::vector<std::optional<Error>> wrong(layers.size());
  tbb::parallel_for(std::size_t{0}, layers.size(), [&](std::size_t k) {
    if (stop.stop_requested()) return;
    auto region = read_layer(layers[k], k, machine);
    if (region)
      regions[k] = std::move(*region);
    else
      wrong[k] = region.error();
  });
  for (const auto& error : wrong)
    if (error) return tl::unexpected{*error};
  if (stop.stop_requested()) return cancelled("planning supports");
  part.layers = without_specks(std::move(regions), part.law.speck_mm2);
  part.to_support.resize(part.layers.size());
  part.islands.resize(part.layers.size());
  const Region nothing;
  tbb::parallel_for(std::size_t{0}, part.layers.size(), [&](std::size_t k) {
    if (stop.stop_requested()) return;
    auto rule = analyse_layer(k == 0 ? nothing : part.layers[k - 1], part.layers[k], part.law);
    part.to_support[k] = std::move(rule.to_support);
    part.islands[k] = std::move(rule.islands);
  });
  if (stop.stop_requested()) return cancelled("planning supports");
  return part;
}

struct LayerStream::State {
  explicit State(const MachineProfile& m) : machine{m} { part.law = self_support_law(m); }

  /// Works off what is waiting; one task at a time does.
  void drain() {
    for (;;) {
      Layer layer;
      {
        const std::scoped_lock lock{mutex};
        if (waiting.empty() || given_up) {
          is_draining = false;
          return;
        }
        layer = std::move(waiting.front());
        waiting.pop_front();
      }
      if (!wrong) take(layer);
    }
  }

  void take(const Layer& layer) {
    const std::size_t k = part.layers.size();
    auto region = read_layer(layer, k, machine);
    if (!region) {
      wrong = region.error();
      return;
    }
    const Region nothing;
    const Region& below = k == 0 ? nothing : part.layers.back();
    Region kept = without_specks(std::move(*region), below, part.law.speck_mm2);
    auto rule = analyse_layer(below, kept, part.law);
    part.layers.push_back(std::move(kept));
    part.to_support.push_back(std::move(rule.to_support));
    part.islands.push_back(std::move(rule.islands));
  }

  MachineProfile machine;
  PartRegions part;            ///< of the draining task, then of finish()
  std::optional<Error> wrong;  ///< likewise
  std::mutex mutex;
  std::deque<Layer> waiting;  ///< guarded by mutex, like the two below
  bool is_draining = false;
  bool given_up = false;
  tbb::task_group tasks;
};

LayerStream::LayerStream(const MachineProfile& machine) : state_{std::make_unique<State>(machine)} {}

LayerStream::~LayerStream() {
  {
    const std::scoped_lock lock{state_->mutex};
    state_->given_up = true;
  }
  state_->tasks.wait();
}

void LayerStream::add(Layer layer) {
  State& state = *state_;
  const std::scoped_lock lock{state.mutex};
  state.waiting.push_back(std::move(layer));
  if (state.is_draining) return;
  state.is_draining = true;
  state.tasks.run([&state] { state.drain(); });
}

Result<PartRegions> LayerStream::finish() {
  state_->tasks.wait();
  if (state_->wrong) return tl::unexpected{*state_->wrong};
  return std::move(state_->part);
}

}  // namespace telefab::fab
