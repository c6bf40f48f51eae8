#include "tile_sampler.hpp"

#include <algorithm>
#include <array>

namespace telefab::fab {
namespace {

constexpr int kMostPadded = 56;  // of a kernel of 5 px spread
constexpr int kMostWindow = kTileSide + kMostPadded;

/// The pixels that a tile's points see. Columns beyond the reach have no weight.
struct Window {
  alignas(32) std::array<float, kMostWindow * kMostWindow> pixels;
  int width;
  int height;

  Window(const DoseField& dose, int x, int y, int reach, int padded, bool swap_axes)
      : width{kTileSide + padded}, height{kTileSide + 2 * reach} {
    const PixelBox& box = dose.box();
    const auto column = [&](int c) { return std::clamp(c - box.x, 0, box.width - 1); };
    if (swap_axes) {
      for (int c = 0; c < width; ++c) {
        const float* row = dose.row(y - reach + c);
        for (int r = 0; r < height; ++r) at(r, c) = row[column(x - reach + r)];
      }
      return;
    }
    const bool inside = x - reach >= box.x && x - reach + width <= box.x + box.width;
    for (int r = 0; r < height; ++r) {
      const float* row = dose.row(y - reach + r);
      if (inside)
        std::copy_n(row + (x - reach - box.x), width, &at(r, 0));
      else
        for (int c = 0; c < width; ++c) at(r, c) = row[column(x - reach + c)];
    }
  }
  float& at(int r, int c) { return pixels[static_cast<std::size_t>(r * width + c)]; }
  [[nodiscard]] const float* row(int r) const { return pixels.data() + static_cast<std::ptrdiff_t>(r) * width; }
};

/// The kernel across the rows: `width` (a multiple of eight) columns of one line.
void blur_across(const Window& window, int first_row, std::span<const float> weights, int taps, float* out) {
  std::fill_n(out, window.width, 0.0F);
  for (int t = 0; t < taps; ++t) {
    const float w = weights[static_cast<std::size_t>(t)];
    const float* row = window.row(first_row + t);
    for (int c = 0; c < window.width; c += 8)
      for (int k = c; k < c + 8; ++k) out[k] += w * row[k];
  }
}

/// The kernel along a blurred line: the same fraction of each of the tile's pixels, `step` apart in `out`.
void blur_along(const float* line, std::span<const float> weights, int taps, float* out, std::size_t step) {
  std::array<float, kTileSide> sums{};
  for (int t = 0; t < taps; ++t) {
    const float w = weights[static_cast<std::size_t>(t)];
    for (int k = 0; k < kTileSide; ++k) sums[static_cast<std::size_t>(k)] += w * line[k + t];
  }
  for (std::size_t k = 0; k < kTileSide; ++k) out[k * step] = sums[k];
}

std::vector<float> phases_of(const PixelKernel& kernel, int count, double shift, int per_pixel) {
  const auto row = static_cast<std::size_t>(kernel.padded());
  std::vector<float> phases(static_cast<std::size_t>(count) * row), slopes(row);
  for (int i = 0; i < count; ++i)
    kernel.weights((i + shift) / per_pixel, {phases.data() + static_cast<std::size_t>(i) * row, row}, slopes);
  return phases;
}

std::span<const float> phase(const std::vector<float>& phases, int i, int padded) {
  return {phases.data() + static_cast<std::ptrdiff_t>(i) * padded, static_cast<std::size_t>(padded)};
}

}  // namespace

TileRange tiles_of(const PixelBox& box) {
  if (box.empty()) return {};
  const auto tile = [](int v) { return v >= 0 ? v / kTileSide : -((-v + kTileSide - 1) / kTileSide); };
  const int x = tile(box.x), y = tile(box.y);
  return {x * kTileSide, y * kTileSide, tile(box.x + box.width - 1) - x + 1, tile(box.y + box.height - 1) - y + 1};
}

std::vector<TileBounds> bounds_of_row(const DoseField& dose, const TileRange& range, int row) {
  const PixelBox& box = dose.box();
  const int reach = dose.kernel().reach(), y = range.y + row * kTileSide;
  const auto width = static_cast<std::size_t>(box.width);
  std::vector<float> least(dose.row(y), dose.row(y) + width), most = least;
  for (int r = y - reach; r < y + kTileSide + reach; ++r) {
    const float* pixels = dose.row(r);
    for (std::size_t x = 0; x < width; ++x) {
      least[x] = std::min(least[x], pixels[x]);
      most[x] = std::max(most[x], pixels[x]);
    }
  }
  std::vector<TileBounds> bounds;
  for (int column = 0; column < range.columns; ++column) {
    const int from = std::clamp(range.x + column * kTileSide - reach - box.x, 0, box.width - 1);
    const int until = std::clamp(range.x + (column + 1) * kTileSide + reach - box.x, from + 1, box.width);
    bounds.push_back({*std::min_element(least.begin() + from, least.begin() + until),
                      *std::max_element(most.begin() + from, most.begin() + until)});
  }
  return bounds;
}

TileSampler::TileSampler(const PixelKernel& kernel, int per_pixel, double shift)
    : per_pixel_{per_pixel},
      reach_{kernel.reach()},
      padded_{kernel.padded()},
      phases_{phases_of(kernel, per_pixel, shift, per_pixel)} {}

void TileSampler::sample(const DoseField& dose, int x, int y, std::span<float> out) const {
  const Window window{dose, x, y, reach_, padded_, false};
  const int taps = 2 * reach_ + 1;
  std::array<float, kMostWindow> line;
  for (int pixel = 0; pixel < kTileSide; ++pixel)
    for (int i = 0; i < per_pixel_; ++i) {
      blur_across(window, pixel, phase(phases_, i, padded_), taps, line.data());
      float* row = out.data() + static_cast<std::size_t>(pixel * per_pixel_ + i) * points();
      for (int j = 0; j < per_pixel_; ++j)
        blur_along(line.data(), phase(phases_, j, padded_), taps, row + j, static_cast<std::size_t>(per_pixel_));
    }
}

LineSampler::LineSampler(const PixelKernel& kernel, int per_pixel, int lines)
    : along_{per_pixel},
      across_{lines},
      reach_{kernel.reach()},
      padded_{kernel.padded()},
      along_phases_{phases_of(kernel, per_pixel + 1, 0, per_pixel)},
      across_phases_{phases_of(kernel, lines, 0.5, lines)} {}

void LineSampler::sample(const DoseField& dose, int x, int y, bool along_y, std::span<float> out) const {
  const Window window{dose, x, y, reach_, padded_, along_y};
  const int taps = 2 * reach_ + 1;
  std::array<float, kMostWindow> line;
  std::array<float, kTileSide> ends;
  for (int pixel = 0; pixel < kTileSide; ++pixel)
    for (int i = 0; i < across_; ++i) {
      blur_across(window, pixel, phase(across_phases_, i, padded_), taps, line.data());
      float* row = out.data() + static_cast<std::size_t>(pixel * across_ + i) * points();
      for (int j = 0; j < along_; ++j)
        blur_along(line.data(), phase(along_phases_, j, padded_), taps, row + j, static_cast<std::size_t>(along_));
      blur_along(line.data(), phase(along_phases_, along_, padded_), taps, ends.data(), 1);
      row[kTileSide * along_] = ends.back();
    }
}

}  // namespace telefab::fab
