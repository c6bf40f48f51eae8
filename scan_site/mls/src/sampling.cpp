#include "sampling.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace telefab::scan {
namespace {

constexpr std::size_t kNeighbours = 12;

/// Calls take(block, d2) for the blocks of eight about a place: d2 are the squared distances of the samples whose
/// normals do not oppose the given one, kFar for the others and for those not in the runs within the radius.
constexpr float kFar = 1e30F;
template <class Take>
void each_block(const SampleGrid& grid, const Eigen::Vector3f& at, const Eigen::Vector3f& normal, float radius,
                Take&& take) {
  const GatherInput arrays = grid.arrays();
  grid.visit(at, radius, [&](std::uint32_t first, std::uint32_t last) {
    for (std::uint32_t block = first / 8; 8 * block < last; ++block) {
      const float* const p = arrays.places + 24 * static_cast<std::size_t>(block);
      const float* const n = arrays.normals + 24 * static_cast<std::size_t>(block);
      const auto from = static_cast<int>(std::max(first, 8 * block) - 8 * block);
      const auto to = static_cast<int>(std::min(last, 8 * block + 8) - 8 * block);
      std::array<float, 8> d2;
      for (int i = 0; i < 8; ++i) {
        const float dx = p[i] - at.x();
        const float dy = p[i + 8] - at.y();
        const float dz = p[i + 16] - at.z();
        const float along = n[i] * normal.x() + n[i + 8] * normal.y() + n[i + 16] * normal.z();
        const float distance2 = dx * dx + dy * dy + dz * dz;
        d2[i] = (along >= 0) & (i >= from) & (i < to) ? distance2 : kFar;
      }
      take(block, d2);
    }
  });
}

/// Squared distance of the twelfth like-oriented neighbour within radius; negative: there are fewer.
float twelfth_within(const SampleGrid& grid, std::uint32_t sample, float radius, std::vector<float>& near) {
  near.clear();
  std::size_t count = 0;
  each_block(grid, grid.place(sample), grid.normal(sample), radius, [&](std::uint32_t, const auto& d2) {
    near.resize(count + 8);
    for (const float d : d2) {
      near[count] = d;
      count += d <= radius * radius ? 1 : 0;
    }
  });
  // The sample itself is the nearest one.
  if (count <= kNeighbours) return -1;
  const auto twelfth = near.begin() + kNeighbours;
  std::nth_element(near.begin(), twelfth, near.begin() + static_cast<std::ptrdiff_t>(count));
  return *twelfth;
}

float spacing_at(const SampleGrid& grid, std::uint32_t sample, float guess, std::vector<float>& near) {
  float radius = 2.5F * guess;
  for (int i = 0; i < 12; ++i, radius *= 1.7F) {
    const float r2 = twelfth_within(grid, sample, radius, near);
    if (r2 >= 0) return std::sqrt(r2 * 0.26179939F);  // pi / 12
  }
  return radius;
}

/// Mean of `spacing` (padded to blocks of eight) over the neighbours within two spacings, itself included.
float averaged(const SampleGrid& grid, const std::vector<float>& spacing, std::uint32_t sample) {
  const float radius = 2 * spacing[sample];
  std::array<float, 8> sum{};
  std::array<float, 8> count{};
  each_block(grid, grid.place(sample), grid.normal(sample), radius, [&](std::uint32_t block, const auto& d2) {
    for (int i = 0; i < 8; ++i) {
      const float one = d2[i] <= radius * radius ? 1.F : 0.F;
      sum[i] += one * spacing[8 * std::size_t{block} + i];
      count[i] += one;
    }
  });
  const float number = std::accumulate(count.begin(), count.end(), 0.F);
  return number > 0 ? std::accumulate(sum.begin(), sum.end(), 0.F) / number : spacing[sample];
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
  std::vector<float> near;
  return spacing_at(grid, sample, guess, near);
}

Evenness measure_evenness(const SampleGrid& grid, float guess) {
  const std::uint32_t n = grid.size();
  const std::uint32_t step = std::max<std::uint32_t>(1, n / 1000);
  std::vector<float> spacing, near;
  float last = guess;
  for (std::uint32_t i = step / 2; i < n; i += step) {
    const float own = spacing_at(grid, i, last, near);
    last = own;
    double sum = 0;
    int count = 0;
    grid.visit(grid.place(i), 1.5F * own, [&](std::uint32_t first, std::uint32_t end) {
      for (std::uint32_t k = first; k < end && count < 12; ++k) {
        if ((grid.place(k) - grid.place(i)).squaredNorm() > 2.25F * own * own) continue;
        sum += spacing_at(grid, k, own, near);
        ++count;
      }
    });
    spacing.push_back(count > 0 ? static_cast<float>(sum / count) : own);
  }
  std::sort(spacing.begin(), spacing.end());
  const auto rank = [&](double share) {
    return static_cast<double>(spacing[static_cast<std::size_t>(share * static_cast<double>(spacing.size() - 1))]);
  };
  return {rank(0.5), rank(0.99) / std::max(rank(0.01), 1e-12)};
}

Result<std::vector<float>> smooth_spacing(const SampleGrid& grid, float guess, std::stop_token stop) {
  const std::uint32_t n = grid.size();
  std::vector<float> spacing((std::size_t{n} + 7) / 8 * 8);
  std::vector<float> next(spacing.size());
  const auto each = [&](auto&& block) {
    tbb::parallel_for(tbb::blocked_range<std::uint32_t>{0, n, 512}, [&](const auto& range) {
      if (!stop.stop_requested()) block(range);
    });
  };
  each([&](const auto& range) {
    std::vector<float> near;
    float last = guess;
    for (std::uint32_t i = range.begin(); i < range.end(); ++i) spacing[i] = last = spacing_at(grid, i, last, near);
  });
  for (int pass = 0; pass < 2; ++pass) {
    each([&](const auto& range) {
      for (std::uint32_t i = range.begin(); i < range.end(); ++i) next[i] = averaged(grid, spacing, i);
    });
    spacing.swap(next);
  }
  if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled while measuring the spacing of the scan");
  spacing.resize(n);
  return spacing;
}

}  // namespace telefab::scan
