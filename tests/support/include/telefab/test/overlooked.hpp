// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/block_stack.hpp>

namespace telefab::test {

/// A block, from layer 5 on with a piece of `size_mm` beside it for `layers` layers; analysed as if nothing had to be
/// held, so that only the masks show what floats.
struct Overlooked {
  Overlooked(double size_mm, std::size_t layers) {
    std::vector<std::vector<Contour>> rings(16, {rectangle(5, 5, 15, 15)});
    for (std::size_t i = 5; i < 5 + layers; ++i) rings[i].push_back(rectangle(20, 20, 20 + size_mm, 20 + size_mm));
    stack = stack_of(rings);
    fab::PartRegions regions = fab::analyse_part(stack.layers(), small_machine(), {}).value();
    for (std::size_t i = 1; i < rings.size(); ++i) {
      regions.to_support[i] = fab::Region{};
      regions.islands[i].clear();
    }
    options.regions = std::make_shared<const fab::PartRegions>(std::move(regions));
  }
  LayerStack stack = table(1, 1);
  fab::PlanOptions options;
};

}  // namespace telefab::test
