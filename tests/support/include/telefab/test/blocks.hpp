// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <telefab/fab/carry/carry_watch.hpp>
#include <telefab/test/block_stack.hpp>
#include <vector>

namespace telefab::test {

/// A box of a print, its faces on pixels and layers. Boxes may overlap.
struct Block {
  double x0, y0, x1, y1;        ///< mm
  std::uint32_t first, behind;  ///< layers
};

constexpr double kBlockPitch = 0.1;

/// The solid pixels of boxes on a raster of 0.1 mm, 20 mm a side, layer by layer.
[[nodiscard]] inline std::vector<fab::LayerRuns> runs_of(const std::vector<Block>& blocks) {
  std::uint32_t layers = 0;
  for (const Block& b : blocks) layers = std::max(layers, b.behind);
  std::vector<fab::LayerRuns> out;
  for (std::uint32_t k = 0; k < layers; ++k) {
    std::vector<Contour> rings;
    for (const Block& b : blocks)
      if (b.first <= k && k < b.behind) rings.push_back(rectangle(b.x0, b.y0, b.x1, b.y1));
    out.push_back(fab::LayerRuns::from_contours(rings, {200, 200}, kBlockPitch));
  }
  return out;
}

[[nodiscard]] inline fab::CarryReport judged(const std::vector<Block>& blocks, fab::CarryOptions options = {}) {
  options.pitch_mm = kBlockPitch;
  options.thickness_mm = 0.5;
  fab::CarryWatch watch{options};
  for (const fab::LayerRuns& runs : runs_of(blocks)) EXPECT_TRUE(watch.add(runs, runs));
  auto report = watch.finish({});
  EXPECT_TRUE(report);
  return std::move(*report);
}

}  // namespace telefab::test
