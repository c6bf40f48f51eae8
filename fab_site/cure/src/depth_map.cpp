// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/cure/depth_map.hpp>

#include "tile_sampler.hpp"

namespace telefab::fab {
namespace {

static_assert(DepthMap::kTilePx == kTileSide);

struct TileRow {
  std::vector<DepthMap::Tile> tiles;
  std::vector<std::uint16_t> depths;
};

}  // namespace

DepthMap DepthMap::of(const DoseField& dose, const CureModel& model, int sub_pixels) {
  DepthMap map;
  map.sub_pixels_ = std::clamp(sub_pixels, 1, 16);
  const TileRange range = tiles_of(dose.box());
  const TileSampler sampler{dose.kernel(), map.sub_pixels_, 0.5};
  const auto through = static_cast<float>(model.through());
  const double per_log = model.penetration_mm / model.layer_mm * kWhole;
  std::vector<TileRow> rows(static_cast<std::size_t>(range.rows));
  tbb::parallel_for(0, range.rows, [&](int r) {
    TileRow& row = rows[static_cast<std::size_t>(r)];
    const auto bounds = bounds_of_row(dose, range, r);
    std::vector<float> doses(sampler.points() * sampler.points());
    for (int c = 0; c < range.columns; ++c) {
      const TileBounds& b = bounds[static_cast<std::size_t>(c)];
      // The kernel's weights sum to one but for rounding.
      if (b.most < 1) continue;
      Tile tile{range.x + c * kTileSide, range.y + r * kTileSide, b.least >= through * 1.00001F, row.depths.size()};
      if (!tile.whole) {
        sampler.sample(dose, tile.x, tile.y, doses);
        bool all = true, any = false;
        for (const float d : doses) {
          std::uint16_t depth = 0;
          if (d >= through)
            depth = kWhole;
          else if (d > 1)
            depth =
                static_cast<std::uint16_t>(std::min<double>(kWhole, std::log(static_cast<double>(d)) * per_log + 0.5));
          all &= depth == kWhole;
          any |= depth != 0;
          row.depths.push_back(depth);
        }
        if (all || !any) row.depths.resize(tile.first);
        if (!any) continue;
        tile.whole = all;
      }
      row.tiles.push_back(tile);
    }
  });
  const double share = 1.0 / (kWhole * static_cast<double>(map.sub_pixels_) * map.sub_pixels_);
  for (TileRow& row : rows) {
    const std::size_t before = map.depths_.size();
    map.depths_.insert(map.depths_.end(), row.depths.begin(), row.depths.end());
    for (Tile tile : row.tiles) {
      tile.first = tile.whole ? 0 : tile.first + before;
      map.tiles_.push_back(tile);
      std::uint64_t sum = 0;
      for (const std::uint16_t depth : map.depths(tile)) sum += depth;
      map.volume_ += tile.whole ? kTilePx * kTilePx : static_cast<double>(sum) * share;
    }
  }
  return map;
}

std::span<const std::uint16_t> DepthMap::depths(const Tile& tile) const {
  if (tile.whole) return {};
  const std::size_t side = static_cast<std::size_t>(kTilePx) * static_cast<std::size_t>(sub_pixels_);
  return {depths_.data() + tile.first, side * side};
}

Digest DepthMap::digest() const {
  Hasher hasher;
  for (const Tile& tile : tiles_) {
    const std::int32_t head[] = {tile.x, tile.y, tile.whole ? 1 : 0};
    hasher.feed(std::as_bytes(std::span{head}));
    hasher.feed(std::as_bytes(depths(tile)));
  }
  return hasher.digest();
}

}  // namespace telefab::fab
