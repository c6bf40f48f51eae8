// SPDX-License-Identifier: GPL-3.0-or-later
#include "mask_survey.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <telefab/fab/mask/pixel_runs.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kNowhere = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint8_t kLit = 128;

/// Lit pixels side by side in one row.
struct LitRun {
  PixelRun pixels;
  std::uint32_t piece;
};

/// Pieces as sets of runs, joined while the rows pass.
class Pieces {
 public:
  std::uint32_t make() {
    parents_.push_back(static_cast<std::uint32_t>(parents_.size()));
    areas_.push_back(0);
    return parents_.back();
  }
  void grow(std::uint32_t piece, std::uint32_t pixels) { areas_[root(piece)] += pixels; }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    if (a == b) return;
    parents_[std::max(a, b)] = std::min(a, b);
    areas_[std::min(a, b)] += areas_[std::max(a, b)];
  }
  void report(LayerSurvey& out) {
    for (std::uint32_t i = 0; i < parents_.size(); ++i) {
      if (parents_[i] != i) continue;
      const auto area = static_cast<double>(areas_[i]);
      out.largest_px = std::max(out.largest_px, area);
      out.smallest_px = out.pieces == 0 ? area : std::min(out.smallest_px, area);
      ++out.pieces;
    }
  }

 private:
  std::uint32_t root(std::uint32_t piece) {
    while (parents_[piece] != piece) piece = parents_[piece] = parents_[parents_[piece]];
    return piece;
  }
  std::vector<std::uint32_t> parents_;
  std::vector<std::uint64_t> areas_;
};

}  // namespace

LayerSurvey survey(const MaskView& mask) {
  LayerSurvey out;
  out.left = mask.size.width_px;
  out.top = mask.size.height_px;
  Pieces pieces;
  std::vector<LitRun> above;
  std::vector<LitRun> here;
  std::uint64_t grey = 0;
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y) {
    const auto row = mask.rows.subspan(std::size_t{y} * mask.size.width_px, mask.size.width_px);
    grey = std::accumulate(row.begin(), row.end(), grey);
    here.clear();
    for (auto at = row.begin(); at != row.end();) {
      at = std::find_if(at, row.end(), [](std::uint8_t v) { return v >= kLit; });
      if (at == row.end()) break;
      const auto end = std::find_if(at, row.end(), [](std::uint8_t v) { return v < kLit; });
      here.push_back(
          {{static_cast<std::int32_t>(at - row.begin()), static_cast<std::int32_t>(end - row.begin())}, pieces.make()});
      pieces.grow(here.back().piece, static_cast<std::uint32_t>(here.back().pixels.width()));
      at = end;
    }
    for (std::size_t i = 0, j = 0; i < here.size() && j < above.size();) {
      if (here[i].pixels.meets(above[j].pixels)) pieces.join(here[i].piece, above[j].piece);
      (here[i].pixels.behind < above[j].pixels.behind ? i : j) += 1;
    }
    if (!here.empty()) {
      out.left = std::min(out.left, static_cast<std::uint32_t>(here.front().pixels.first));
      out.right = std::max(out.right, static_cast<std::uint32_t>(here.back().pixels.behind));
      out.top = std::min(out.top, y);
      out.bottom = y + 1;
    }
    above.swap(here);
  }
  out.solid_px = static_cast<double>(grey) / 255;
  pieces.report(out);
  if (out.pieces == 0) out.left = out.top = 0;
  return out;
}

ViewFromAbove::ViewFromAbove(PixelSize mask, std::uint32_t width_px, std::uint32_t height_px)
    : mask_{mask}, width_px_{width_px}, height_px_{height_px}, heights_(std::size_t{width_px} * height_px) {
  const double scale =
      std::max(static_cast<double>(mask.width_px) / width_px, static_cast<double>(mask.height_px) / height_px);
  const auto places = [&](std::uint32_t picture, std::uint32_t pixels) {
    std::vector<std::uint32_t> out(picture, kNowhere);
    for (std::uint32_t i = 0; i < picture; ++i) {
      const double at = (i + 0.5 - picture / 2.0) * scale + pixels / 2.0;
      if (at >= 0 && at < pixels) out[i] = static_cast<std::uint32_t>(at);
    }
    return out;
  };
  columns_ = places(width_px, mask.width_px);
  rows_ = places(height_px, mask.height_px);
}

void ViewFromAbove::add(const MaskView& mask, std::uint32_t layer) {
  for (std::uint32_t y = 0; y < height_px_; ++y) {
    if (rows_[y] == kNowhere) continue;
    const std::uint8_t* row = mask.rows.data() + std::size_t{rows_[y]} * mask_.width_px;
    std::uint32_t* to = heights_.data() + std::size_t{y} * width_px_;
    for (std::uint32_t x = 0; x < width_px_; ++x)
      if (columns_[x] != kNowhere && row[columns_[x]] >= kLit) to[x] = layer + 1;
  }
}

Image ViewFromAbove::image(std::uint32_t layers) const {
  Image out{width_px_, height_px_, 3, std::vector<std::uint8_t>(std::size_t{width_px_} * height_px_ * 3)};
  const double per_layer = 1.0 / std::max(layers, 1U);
  const auto height = [&](std::uint32_t x, std::uint32_t y) {
    return heights_[std::size_t{std::min(y, height_px_ - 1)} * width_px_ + std::min(x, width_px_ - 1)] * per_layer;
  };
  for (std::uint32_t y = 0; y < height_px_; ++y)
    for (std::uint32_t x = 0; x < width_px_; ++x) {
      std::uint8_t* to = out.pixels.data() + 3 * (std::size_t{y} * width_px_ + x);
      const bool lit = heights_[std::size_t{y} * width_px_ + x] != 0;
      const double slope =
          height(x + 1, y) - height(x == 0 ? 0 : x - 1, y) + height(x, y + 1) - height(x, y == 0 ? 0 : y - 1);
      const double light = lit ? std::clamp(0.35 + 0.45 * height(x, y) + 4 * slope, 0.15, 1.0) : 0.0;
      constexpr double colour[3] = {250, 176, 84};
      constexpr double ground[3] = {28, 25, 23};
      for (int c = 0; c < 3; ++c) to[c] = static_cast<std::uint8_t>(std::lround(lit ? colour[c] * light : ground[c]));
    }
  return out;
}

}  // namespace telefab::fab
