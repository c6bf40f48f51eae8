// SPDX-License-Identifier: GPL-3.0-or-later
#include "tile_sampler.hpp"

#include <tbb/parallel_for.h>

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

// Plain loops in a fixed order, no contraction: the same bytes on every instruction set.

/// The kernel across the rows: `width` (a multiple of eight) columns of one line.
[[gnu::target_clones("avx2", "default")]] void blur_across(const float* pixels, int width, const float* weights,
                                                           int taps, float* out) {
  for (int c = 0; c < width; c += 8) {
    std::array<float, 8> sums{};
    for (int t = 0; t < taps; ++t) {
      const float w = weights[t];
      const float* row = pixels + static_cast<std::ptrdiff_t>(t) * width + c;
      for (std::size_t k = 0; k < 8; ++k) sums[k] += w * row[k];
    }
    for (std::size_t k = 0; k < 8; ++k) out[static_cast<std::size_t>(c) + k] = sums[k];
  }
}

/// The kernel along a blurred line: the same fraction of each of the tile's pixels.
[[gnu::target_clones("avx2", "default")]] void blur_along(const float* line, const float* weights, int taps,
                                                          float* out) {
  std::array<float, kTileSide> sums{};
  for (int t = 0; t < taps; ++t) {
    const float w = weights[t];
    for (std::size_t k = 0; k < kTileSide; ++k) sums[k] += w * line[static_cast<std::size_t>(t) + k];
  }
  for (std::size_t k = 0; k < kTileSide; ++k) out[k] = sums[k];
}

/// Takes a row into the bounds of columns.
[[gnu::target_clones("avx2", "default")]] void widen(const float* row, std::size_t width, float* least, float* most) {
  for (std::size_t x = 0; x < width; ++x) {
    least[x] = row[x] < least[x] ? row[x] : least[x];
    most[x] = row[x] > most[x] ? row[x] : most[x];
  }
}

/// `count` fractions of every pixel of a line, in the order of their places.
void blur_line(const float* line, const std::vector<float>& phases, int count, int padded, int taps, float* out) {
  std::array<float, kTileSide * 16> planes;
  for (int i = 0; i < count; ++i)
    blur_along(line, phases.data() + static_cast<std::ptrdiff_t>(i) * padded, taps, planes.data() + i * kTileSide);
  for (int k = 0; k < kTileSide; ++k)
    for (int i = 0; i < count; ++i) *out++ = planes[static_cast<std::size_t>(i * kTileSide + k)];
}

std::vector<float> phases_of(const PixelKernel& kernel, int count, double shift, int per_pixel) {
  const auto row = static_cast<std::size_t>(kernel.padded());
  std::vector<float> phases(static_cast<std::size_t>(count) * row), slopes(row);
  for (int i = 0; i < count; ++i)
    kernel.weights((i + shift) / per_pixel, {phases.data() + static_cast<std::size_t>(i) * row, row}, slopes);
  return phases;
}

const float* phase(const std::vector<float>& phases, int i, int padded) {
  return phases.data() + static_cast<std::ptrdiff_t>(i) * padded;
}

}  // namespace

TileRange tiles_of(const PixelBox& box) {
  if (box.empty()) return {};
  const auto tile = [](int v) { return v >= 0 ? v / kTileSide : -((-v + kTileSide - 1) / kTileSide); };
  const int x = tile(box.x), y = tile(box.y);
  return {x * kTileSide, y * kTileSide, tile(box.x + box.width - 1) - x + 1, tile(box.y + box.height - 1) - y + 1};
}

std::vector<TileBounds> all_bounds(const DoseField& dose) {
  const TileRange range = tiles_of(dose.box());
  const PixelBox& box = dose.box();
  const int reach = dose.kernel().reach();
  const auto width = static_cast<std::size_t>(box.width);
  std::vector<TileBounds> bounds(static_cast<std::size_t>(range.rows) * static_cast<std::size_t>(range.columns));
  tbb::parallel_for(0, range.rows, [&](int row) {
    const int y = range.y + row * kTileSide;
    std::vector<float> least(dose.row(y), dose.row(y) + width), most = least;
    for (int r = std::max(box.y, y - reach); r < std::min(box.y + box.height, y + kTileSide + reach); ++r)
      widen(dose.row(r), width, least.data(), most.data());
    for (int column = 0; column < range.columns; ++column) {
      const int from = std::clamp(range.x + column * kTileSide - reach - box.x, 0, box.width - 1);
      const int until = std::clamp(range.x + (column + 1) * kTileSide + reach - box.x, from + 1, box.width);
      bounds[static_cast<std::size_t>(row) * static_cast<std::size_t>(range.columns) +
             static_cast<std::size_t>(column)] = {*std::min_element(least.begin() + from, least.begin() + until),
                                                  *std::max_element(most.begin() + from, most.begin() + until)};
    }
  });
  return bounds;
}

std::vector<TileBounds> bounds_of_row(const DoseField& dose, const TileRange& range, int row) {
  std::vector<TileBounds> bounds(static_cast<std::size_t>(range.columns));
  const TileRange own = tiles_of(dose.box());
  if (own.rows == 0) return bounds;
  const auto within = [](int from, int own_from, int count) {
    return static_cast<std::size_t>(std::clamp((from - own_from) / kTileSide, 0, count - 1));
  };
  const std::size_t first = within(range.y + row * kTileSide, own.y, own.rows) * static_cast<std::size_t>(own.columns);
  for (int column = 0; column < range.columns; ++column)
    bounds[static_cast<std::size_t>(column)] =
        dose.tile_bounds()[first + within(range.x + column * kTileSide, own.x, own.columns)];
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
      blur_across(window.row(pixel), window.width, phase(phases_, i, padded_), taps, line.data());
      blur_line(line.data(), phases_, per_pixel_, padded_, taps,
                out.data() + static_cast<std::size_t>(pixel * per_pixel_ + i) * points());
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
      blur_across(window.row(pixel), window.width, phase(across_phases_, i, padded_), taps, line.data());
      float* row = out.data() + static_cast<std::size_t>(pixel * across_ + i) * points();
      blur_line(line.data(), along_phases_, along_, padded_, taps, row);
      blur_along(line.data(), phase(along_phases_, along_, padded_), taps, ends.data());
      row[kTileSide * along_] = ends.back();
    }
}

}  // namespace telefab::fab
