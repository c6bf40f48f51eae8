// SPDX-License-Identifier: GPL-3.0-or-later
#include "sampling.hpp"

#include <Eigen/Geometry>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace telefab::scan {
namespace {

constexpr std::size_t kNeighbours = 12;
/// Square of the spacing over that of the distance of the twelfth neighbour.
constexpr float kSpacing2 = 0.26179939F;  // pi / 12
/// How far, in spacings, the next rows are looked for: farther where a direction shows no sample.
constexpr std::array<float, 2> kGapReaches{6, 16};
/// Nearer than this, in spacings, lies another view of the same place.
constexpr float kSamePlace = 0.05F;
/// Samples whose normals agree by less belong to another side of the part.
constexpr float kSameSide = 0.3F;
/// A sample is turned the wrong way where so many of its twelve neighbours look the other way,
constexpr std::size_t kMostTurned = 8;
/// and lie in its own plane within this many spacings: the other side of a wall does not.
constexpr float kInPlane = 0.5F;
/// It is looked for where the neighbours of its own side are farther than this many spacings of the scan.
constexpr float kFarOwnSide = 2.5F;
/// Over the spacing, gaps up to the first are those of samples without rows (a square grid: 1.41), and from the second
/// on rows decide.
constexpr float kNoRows = 1.5F;
constexpr float kRows = 2.0F;
/// A scan has rows where a tenth of its samples, each averaged with its neighbours, has gaps wider than this.
constexpr double kRowyGap = 1.6;

/// Asks about one sample after another; keeps its work space.
class Surroundings {
 public:
  /// `typical`: spacing of the scan, about.
  Surroundings(const SampleGrid& grid, float typical) : grid_{grid}, typical_{typical}, kernels_{fastest_kernels()} {}

  /// local_spacing of the header.
  float spacing(std::uint32_t sample, float guess) {
    float radius = 2.3F * guess;
    for (int i = 0; i < 12; ++i, radius *= 1.7F) {
      const NearInput in = about(sample, radius);
      if (distances_.size() < samples_ + 8) distances_.resize(samples_ + 8);
      const std::size_t count = kernels_.distances(in, runs_.data(), runs_.size(), distances_.data());
      // The sample itself is the nearest one.
      if (count <= kNeighbours) continue;
      const auto twelfth = distances_.begin() + kNeighbours;
      std::nth_element(distances_.begin(), twelfth, distances_.begin() + static_cast<std::ptrdiff_t>(count));
      const float own = std::sqrt(*twelfth * kSpacing2);
      return own > kFarOwnSide * typical_ ? spacing_if_turned(sample, own).value_or(own) : own;
    }
    return radius;
  }

  /// The widest gap across the sample: of three double sectors of its tangent plane, each with the distance to its
  /// nearest sample on the nearer side, the largest. Even sampling has gaps of its spacing; samples in rows, as line
  /// scanners take them, of the distance of the rows. At the border of a scan the side without samples does not count.
  float gap(std::uint32_t sample, float spacing) const {
    const Eigen::Vector3f place = grid_.place(sample);
    const Eigen::Vector3f normal = grid_.normal(sample);
    const Eigen::Vector3f u = normal.unitOrthogonal();
    const Eigen::Vector3f v = normal.cross(u);
    float widest = 0;
    for (const float reach : kGapReaches) {
      const float most = reach * reach * spacing * spacing;
      std::array<float, 6> nearest;
      nearest.fill(most);
      grid_.visit(place, reach * spacing, [&](std::uint32_t first, std::uint32_t last) {
        for (std::uint32_t k = first; k < last; ++k) {
          const Eigen::Vector3f d = grid_.place(k) - place;
          const float x = d.dot(u), y = d.dot(v);
          const float flat = x * x + y * y;
          if (flat >= most || flat < kSamePlace * kSamePlace * spacing * spacing) continue;
          if (grid_.normal(k).dot(normal) < kSameSide) continue;
          float& of_sector = nearest[sector(x, y)];
          of_sector = std::min(of_sector, flat);
        }
      });
      widest = 0;
      bool all = true;
      for (std::size_t s = 0; s < 3; ++s) {
        const float near = std::min(nearest[s], nearest[s + 3]);
        if (near < most)
          widest = std::max(widest, near);
        else
          all = false;
      }
      if (all) break;
    }
    if (widest > kNoRows * kNoRows * spacing * spacing && spacing_if_turned(sample, 3 * spacing)) return spacing;
    return std::sqrt(widest);
  }

  /// Distance of the nearest sample of the same side that is not another view of the same place; 1.5 spacings at most.
  float nearest(std::uint32_t sample, float spacing) const {
    const Eigen::Vector3f place = grid_.place(sample);
    const float same = kSamePlace * kSamePlace * spacing * spacing;
    float least = 2.25F * spacing * spacing;
    grid_.visit(place, 1.5F * spacing, [&](std::uint32_t first, std::uint32_t last) {
      for (std::uint32_t k = first; k < last; ++k) {
        const float apart = (grid_.place(k) - place).squaredNorm();
        if (apart >= same && apart < least && grid_.normal(k).dot(grid_.normal(sample)) >= kSameSide) least = apart;
      }
    });
    return std::sqrt(least);
  }

  /// Mean of `spacing` (aligned, one a sample) over the neighbours within two spacings, itself included.
  float averaged(std::uint32_t sample, const float* spacing) {
    const NearInput in = about(sample, 2 * spacing[sample]);
    return kernels_.mean(in, runs_.data(), runs_.size(), spacing, spacing[sample]);
  }

 private:
  /// Sixths of a turn, counter-clockwise; by signs only, so that every machine tells the same.
  static std::size_t sector(float x, float y) {
    constexpr float kRoot3 = 1.7320508F;
    const bool above_rising = y > kRoot3 * x;
    const bool above_falling = y > -kRoot3 * x;
    if (y > 0) return above_rising ? (above_falling ? 1 : 2) : 0;
    return above_falling ? 5 : above_rising ? 3 : 4;
  }

  /// The spacing of all samples within `reach` of one that looks the wrong way; none for any other. A few turned
  /// normals are nobody's side: their own neighbours are far, and with kernels as wide as that they would blur whole
  /// faces.
  std::optional<float> spacing_if_turned(std::uint32_t sample, float reach) const {
    const Eigen::Vector3f place = grid_.place(sample);
    const Eigen::Vector3f normal = grid_.normal(sample);
    std::vector<std::pair<float, std::uint32_t>> near;
    grid_.visit(place, reach, [&](std::uint32_t first, std::uint32_t last) {
      for (std::uint32_t k = first; k < last; ++k)
        if (k != sample) near.emplace_back((grid_.place(k) - place).squaredNorm(), k);
    });
    if (near.size() < kNeighbours) return std::nullopt;
    const auto twelfth = near.begin() + (kNeighbours - 1);
    std::nth_element(near.begin(), twelfth, near.end());
    const float spacing = std::sqrt(twelfth->first * kSpacing2);
    const auto turned = std::count_if(near.begin(), twelfth + 1, [&](const auto& n) {
      return grid_.normal(n.second).dot(normal) < -kSameSide &&
             std::abs((grid_.place(n.second) - place).dot(normal)) < kInPlane * spacing;
    });
    if (static_cast<std::size_t>(turned) < kMostTurned) return std::nullopt;
    return spacing;
  }

  NearInput about(std::uint32_t sample, float radius) {
    const Eigen::Vector3f place = grid_.place(sample);
    const Eigen::Vector3f normal = grid_.normal(sample);
    runs_.clear();
    samples_ = 0;
    grid_.visit(place, radius, [&](std::uint32_t first, std::uint32_t last) {
      runs_.push_back({first, last});
      samples_ += last - first;
    });
    const GatherInput arrays = grid_.arrays();
    return {arrays.places, arrays.normals, place.x(),  place.y(),      place.z(),
            normal.x(),    normal.y(),     normal.z(), radius * radius};
  }

  const SampleGrid& grid_;
  float typical_;
  KernelSet kernels_;
  std::vector<SampleRun> runs_;
  std::size_t samples_ = 0;
  std::vector<float> distances_;
};

/// The spacing that decides the width of the kernel: that of the samples, or, where they lie in rows, of the rows.
float across_rows(float spacing, float gap) {
  const float share = std::clamp((gap / spacing - kNoRows) / (kRows - kNoRows), 0.0F, 1.0F);
  return spacing + share * (gap - spacing);
}

}  // namespace

float spacing_from_box(std::span<const Eigen::Vector3f> points) {
  Eigen::Vector3f low = points[0];
  Eigen::Vector3f high = low;
  for (const Eigen::Vector3f& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector3f size = high - low;
  const float area = 2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
  const float guess = std::sqrt(area / static_cast<float>(points.size()));
  return std::max({guess, size.maxCoeff() * 1e-5F, 1e-6F});
}

float local_spacing(const SampleGrid& grid, std::uint32_t sample, float guess) {
  return Surroundings{grid, guess}.spacing(sample, guess);
}

Evenness measure_evenness(const SampleGrid& grid, float guess) {
  const std::uint32_t n = grid.size();
  const std::uint32_t step = std::max<std::uint32_t>(1, n / 1000);
  Surroundings surroundings{grid, guess};
  std::vector<float> spacing, across;
  std::vector<double> gaps;
  std::vector<float> nearest;
  float last = guess;
  for (std::uint32_t i = step / 2; i < n; i += step) {
    const float own = surroundings.spacing(i, last);
    last = own;
    nearest.push_back(surroundings.nearest(i, own) / own);
    double sum = 0, gap_sum = 0;
    int count = 0;
    grid.visit(grid.place(i), 1.5F * own, [&](std::uint32_t first, std::uint32_t end) {
      for (std::uint32_t k = first; k < end && count < 12; ++k) {
        if ((grid.place(k) - grid.place(i)).squaredNorm() > 2.25F * own * own) continue;
        const float near = surroundings.spacing(k, own);
        sum += near;
        gap_sum += surroundings.gap(k, near) / near;
        ++count;
      }
    });
    spacing.push_back(count > 0 ? static_cast<float>(sum / count) : own);
    gaps.push_back(count > 0 ? gap_sum / count : surroundings.gap(i, own) / own);
    across.push_back(across_rows(spacing.back(), static_cast<float>(gaps.back()) * spacing.back()));
  }
  std::sort(gaps.begin(), gaps.end());
  const bool rows = gaps[static_cast<std::size_t>(0.9 * static_cast<double>(gaps.size() - 1))] > kRowyGap;
  if (rows) spacing = std::move(across);
  std::sort(spacing.begin(), spacing.end());
  const auto rank = [&](double share) {
    return static_cast<double>(spacing[static_cast<std::size_t>(share * static_cast<double>(spacing.size() - 1))]);
  };
  const auto middle = nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2);
  std::nth_element(nearest.begin(), middle, nearest.end());
  return {rank(0.5), rank(0.99) / std::max(rank(0.01), 1e-12), rows, static_cast<double>(*middle)};
}

Result<std::vector<float>> smooth_spacing(const SampleGrid& grid, float guess, bool rows, std::stop_token stop) {
  const std::uint32_t n = grid.size();
  using Widths = SampleGrid::Widths;  // aligned
  std::vector<Widths> spacing((std::size_t{n} + 7) / 8);
  std::vector<Widths> next(spacing.size());
  const auto each = [&](auto&& one) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, spacing.size(), 64}, [&](const auto& range) {
      if (stop.stop_requested()) return;
      Surroundings surroundings{grid, guess};
      float last = guess;
      for (std::size_t block = range.begin(); block < range.end(); ++block)
        for (std::size_t i = 8 * block; i < std::min<std::size_t>(n, 8 * block + 8); ++i)
          one(surroundings, static_cast<std::uint32_t>(i), last);
    });
  };
  each([&](Surroundings& s, std::uint32_t i, float& last) { spacing[i / 8].width[i % 8] = last = s.spacing(i, last); });
  if (rows)
    each([&](Surroundings& s, std::uint32_t i, float&) {
      float& own = spacing[i / 8].width[i % 8];
      own = across_rows(own, s.gap(i, own));
    });
  for (int pass = 0; pass < 2; ++pass) {
    each([&](Surroundings& s, std::uint32_t i, float&) { next[i / 8].width[i % 8] = s.averaged(i, spacing[0].width); });
    spacing.swap(next);
  }
  std::vector<Widths>{}.swap(next);
  if (stop.stop_requested()) return cancelled("measuring the spacing of the scan");
  std::vector<float> flat(n);
  for (std::uint32_t i = 0; i < n; ++i) flat[i] = spacing[i / 8].width[i % 8];
  return flat;
}

}  // namespace telefab::scan
