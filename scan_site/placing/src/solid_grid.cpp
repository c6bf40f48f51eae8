// SPDX-License-Identifier: GPL-3.0-or-later
#include "solid_grid.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <telefab/scan/completion/winding_tree.hpp>

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

/// Side of the bricks that corners are asked in, so that those of a block lie together.
constexpr int kBrick = 4;
/// Corners this near to a sample, in pitches, ask for the distance; the others for the side alone.
constexpr float kNear = 2.5F;
/// Corners that are asked before somebody may stop it; blocks of the tree divide it.
constexpr std::size_t kPortion = 65'536;

}  // namespace

SolidGrid::SolidGrid(const std::vector<Vector3f>& points, const std::vector<Vector3f>& normals,
                     const std::vector<float>& areas, double corners, const std::stop_token& stop) {
  Vector3f low = points.front(), high = points.front();
  for (const Vector3f& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vector3f size = (high - low).cwiseMax(1e-3F * (high - low).maxCoeff());
  pitch_ = static_cast<float>(std::cbrt(static_cast<double>(size.prod()) / corners));
  // A flat part needs corners across it.
  pitch_ = std::min(pitch_, std::max(size.minCoeff() / 12, size.maxCoeff() / 160));
  low_ = low - Vector3f::Constant(2 * pitch_);
  for (std::size_t a = 0; a < 3; ++a)
    count_[a] = static_cast<int>(std::ceil(size[static_cast<Eigen::Index>(a)] / pitch_)) + 5;
  const int nx = count_[0], ny = count_[1], nz = count_[2];
  const auto index = [&](int x, int y, int z) {
    return static_cast<std::size_t>(x) +
           static_cast<std::size_t>(nx) *
               (static_cast<std::size_t>(y) + static_cast<std::size_t>(ny) * static_cast<std::size_t>(z));
  };
  distance_.assign(index(0, 0, nz), kBand * pitch_);

  std::vector<char> near(distance_.size(), 0);
  for (const Vector3f& p : points) {
    const Vector3f at = (p - low_) / pitch_;
    const auto from = [&](int a) { return std::max(0, static_cast<int>(std::ceil(at[a] - kNear))); };
    const auto to = [&](int a) {
      return std::min(count_[static_cast<std::size_t>(a)] - 1, static_cast<int>(std::floor(at[a] + kNear)));
    };
    for (int z = from(2); z <= to(2); ++z)
      for (int y = from(1); y <= to(1); ++y)
        std::fill_n(near.begin() + static_cast<std::ptrdiff_t>(index(from(0), y, z)), to(0) - from(0) + 1, 1);
  }
  std::vector<Vector3f> near_places, far_places;
  std::vector<std::size_t> near_at, far_at;
  for (int bz = 0; bz < nz; bz += kBrick)
    for (int by = 0; by < ny; by += kBrick)
      for (int bx = 0; bx < nx; bx += kBrick)
        for (int z = bz; z < std::min(nz, bz + kBrick); ++z)
          for (int y = by; y < std::min(ny, by + kBrick); ++y)
            for (int x = bx; x < std::min(nx, bx + kBrick); ++x) {
              const Vector3f place =
                  low_ + pitch_ * Vector3f{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
              const std::size_t i = index(x, y, z);
              (near[i] ? near_places : far_places).push_back(place);
              (near[i] ? near_at : far_at).push_back(i);
            }
  const WindingTree tree{points, normals, areas};
  const auto in_portions = [&](std::size_t count, auto&& ask) {
    for (std::size_t from = 0; from < count && !stop.stop_requested(); from += kPortion)
      ask(from, std::min(kPortion, count - from));
  };
  in_portions(near_at.size(), [&](std::size_t from, std::size_t count) {
    const auto wides = tree.wides(std::span{near_places}.subspan(from, count));
    for (std::size_t k = 0; k < count; ++k) {
      const WideField& f = wides[k];
      const float side = 2 * kBand * pitch_ * (0.5F - f.winding);
      distance_[near_at[from + k]] =
          std::clamp(f.agreement * f.value + (1 - f.agreement) * side, -kBand * pitch_, kBand * pitch_);
    }
  });
  in_portions(far_at.size(), [&](std::size_t from, std::size_t count) {
    const auto windings = tree.windings(std::span{far_places}.subspan(from, count));
    for (std::size_t k = 0; k < count; ++k)
      distance_[far_at[from + k]] = (windings[k] > 0.5F ? -kBand : kBand) * pitch_;
  });
}

SolidGrid SolidGrid::thinned(int step) const {
  SolidGrid coarse;
  coarse.low_ = low_;
  coarse.pitch_ = pitch_ * static_cast<float>(step);
  for (std::size_t a = 0; a < 3; ++a) coarse.count_[a] = (count_[a] - 2) / step + 2;
  for (int z = 0; z < coarse.count_[2]; ++z)
    for (int y = 0; y < coarse.count_[1]; ++y)
      for (int x = 0; x < coarse.count_[0]; ++x) {
        const bool within = x * step < count_[0] && y * step < count_[1] && z * step < count_[2];
        const std::size_t i = static_cast<std::size_t>(x * step) +
                              static_cast<std::size_t>(count_[0]) *
                                  (static_cast<std::size_t>(y * step) +
                                   static_cast<std::size_t>(count_[1]) * static_cast<std::size_t>(z * step));
        coarse.distance_.push_back(within ? distance_[i] : kBand * pitch_);
      }
  return coarse;
}

SolidGrid::Cell SolidGrid::cell_of(const Vector3f& place) const {
  const Vector3f at = (place - low_) / pitch_;
  Cell cell;
  std::array<std::size_t, 3> corner{};
  for (int a = 0; a < 3; ++a) {
    const auto i = static_cast<std::size_t>(a);
    if (!(at[a] >= 0) || at[a] >= static_cast<float>(count_[i] - 1)) return cell;
    corner[i] = static_cast<std::size_t>(at[a]);
    cell.within[a] = at[a] - static_cast<float>(corner[i]);
  }
  cell.corner =
      corner[0] + static_cast<std::size_t>(count_[0]) * (corner[1] + static_cast<std::size_t>(count_[1]) * corner[2]);
  cell.is_inside = true;
  return cell;
}

float SolidGrid::distance(const Vector3f& place) const {
  const Cell cell = cell_of(place);
  if (!cell.is_inside) return kBand * pitch_;
  const std::size_t row = static_cast<std::size_t>(count_[0]), plane = row * static_cast<std::size_t>(count_[1]);
  const float* const c = distance_.data() + cell.corner;
  const auto mix = [](float a, float b, float t) { return a + t * (b - a); };
  const Vector3f& t = cell.within;
  const float y0 = mix(mix(c[0], c[1], t.x()), mix(c[row], c[row + 1], t.x()), t.y());
  const float y1 = mix(mix(c[plane], c[plane + 1], t.x()), mix(c[plane + row], c[plane + row + 1], t.x()), t.y());
  return mix(y0, y1, t.z());
}

SolidGrid::Answer SolidGrid::at(const Vector3f& place) const {
  Answer answer{distance(place), {}};
  for (int a = 0; a < 3; ++a) {
    const Vector3f step = pitch_ / 2 * Vector3f::Unit(a);
    answer.gradient[a] = (distance(place + step) - distance(place - step)) / pitch_;
  }
  return answer;
}

}  // namespace telefab::scan
