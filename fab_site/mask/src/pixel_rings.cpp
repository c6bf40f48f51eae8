// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <telefab/fab/mask/pixel_rings.hpp>

namespace telefab::fab {
namespace {

/// Steps along edges of pixels: right, back, left, front.
constexpr std::array<int, 4> kStepX{1, 0, -1, 0}, kStepY{0, 1, 0, -1};
constexpr std::uint8_t kNone = 4;

}  // namespace

std::uint64_t PixelSet::count() const {
  return static_cast<std::uint64_t>(std::count(lit_.begin(), lit_.end(), std::uint8_t{1}));
}

PixelSet PixelSet::joined() const {
  PixelSet out = *this;
  for (bool changed = true; changed;) {
    changed = false;
    for (int y = 0; y + 1 < height_; ++y)
      for (int x = 0; x + 1 < width_; ++x) {
        const std::uint8_t *front = &out.lit_[out.place(x, y)], *back = front + width_;
        const bool a = front[0] != 0, b = front[1] != 0, c = back[0] != 0, d = back[1] != 0;
        if (a == d && b == c && a != b) {
          out.add(a ? x + 1 : x, y);
          changed = true;
        }
      }
  }
  return out;
}

Result<std::vector<Contour>> PixelSet::rings(double pitch_mm) const {
  const PixelSet set = joined();
  const int across = width_ + 1;
  const auto corner = [&](int x, int y) { return static_cast<std::size_t>(y * across + x); };
  std::vector<std::uint8_t> out(static_cast<std::size_t>(across) * static_cast<std::size_t>(height_ + 1), kNone);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      if (!set.has(x, y)) continue;
      if (!set.has(x, y - 1)) out[corner(x, y)] = 0;
      if (!set.has(x + 1, y)) out[corner(x + 1, y)] = 1;
      if (!set.has(x, y + 1)) out[corner(x + 1, y + 1)] = 2;
      if (!set.has(x - 1, y)) out[corner(x, y + 1)] = 3;
    }
  std::vector<Contour> rings;
  for (std::size_t start = 0; start < out.size(); ++start) {
    if (out[start] == kNone) continue;
    std::vector<Point2> ring;
    int x = static_cast<int>(start) % across, y = static_cast<int>(start) / across;
    // The first corner in this order always turns: what is before it in its row and column is not on the ring.
    for (std::uint8_t before = kNone; out[corner(x, y)] != kNone;) {
      const std::uint8_t way = out[corner(x, y)];
      out[corner(x, y)] = kNone;
      if (way != before) ring.push_back({(left_ + x) * pitch_mm, (front_ + y) * pitch_mm});
      before = way;
      x += kStepX[way];
      y += kStepY[way];
    }
    auto contour = Contour::from_vertices(std::move(ring));
    if (!contour) return tl::unexpected{contour.error()};
    rings.push_back(std::move(*contour));
  }
  return rings;
}

}  // namespace telefab::fab
