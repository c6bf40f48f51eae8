#include "sampling.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace telefab::scan {
namespace {

constexpr std::size_t kNeighbours = 12;

/// Squared distance of the twelfth like-oriented neighbour within radius; negative: there are fewer.
float twelfth_within(const SampleGrid& grid, const GridSample& at, float radius) {
  std::array<float, kNeighbours> nearest;  // rising
  std::size_t count = 0;
  grid.visit({at.x, at.y, at.z}, radius, [&](const GridSample* s, std::size_t n) {
    for (const GridSample* const end = s + n; s != end; ++s) {
      const float dx = s->x - at.x;
      const float dy = s->y - at.y;
      const float dz = s->z - at.z;
      const float d2 = dx * dx + dy * dy + dz * dz;
      if (s == &at || d2 > radius * radius || (count == kNeighbours && d2 >= nearest[kNeighbours - 1])) continue;
      if (s->nx * at.nx + s->ny * at.ny + s->nz * at.nz < 0) continue;
      std::size_t i = count < kNeighbours ? count++ : kNeighbours - 1;
      for (; i > 0 && nearest[i - 1] > d2; --i) nearest[i] = nearest[i - 1];
      nearest[i] = d2;
    }
  });
  return count == kNeighbours ? nearest[kNeighbours - 1] : -1;
}

/// Mean of `spacing` over the neighbours within two spacings, itself included.
float averaged(const SampleGrid& grid, const std::vector<float>& spacing, std::size_t index) {
  const GridSample& at = grid.samples()[index];
  const float radius = 2 * spacing[index];
  double sum = 0;
  std::size_t count = 0;
  grid.visit({at.x, at.y, at.z}, radius, [&](const GridSample* s, std::size_t n) {
    for (const GridSample* const end = s + n; s != end; ++s) {
      const float dx = s->x - at.x;
      const float dy = s->y - at.y;
      const float dz = s->z - at.z;
      if (dx * dx + dy * dy + dz * dz > radius * radius) continue;
      if (s->nx * at.nx + s->ny * at.ny + s->nz * at.nz < 0) continue;
      sum += spacing[s - grid.samples().data()];
      ++count;
    }
  });
  return count > 0 ? static_cast<float>(sum / static_cast<double>(count)) : spacing[index];
}

}  // namespace

float spacing_from_box(const std::vector<GridSample>& samples) {
  Eigen::Vector3f low{samples[0].x, samples[0].y, samples[0].z};
  Eigen::Vector3f high = low;
  for (const GridSample& s : samples) {
    low = low.cwiseMin(Eigen::Vector3f{s.x, s.y, s.z});
    high = high.cwiseMax(Eigen::Vector3f{s.x, s.y, s.z});
  }
  const Eigen::Vector3f size = high - low;
  const float area = 2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
  const float guess = std::sqrt(area / static_cast<float>(samples.size()));
  return std::max({guess, size.maxCoeff() * 1e-5F, 1e-6F});
}

float local_spacing(const SampleGrid& grid, const GridSample& sample, float guess) {
  float radius = 2.5F * guess;
  for (int i = 0; i < 12; ++i, radius *= 1.7F) {
    const float r2 = twelfth_within(grid, sample, radius);
    if (r2 >= 0) return std::sqrt(r2 * 0.26179939F);  // pi / 12
  }
  return radius;
}

Evenness measure_evenness(const SampleGrid& grid, float guess) {
  const std::size_t n = grid.samples().size();
  const std::size_t step = std::max<std::size_t>(1, n / 1000);
  std::vector<float> spacing;
  float near = guess;
  for (std::size_t i = step / 2; i < n; i += step) {
    const GridSample& at = grid.samples()[i];
    const float own = local_spacing(grid, at, near);
    near = own;
    double sum = 0;
    int count = 0;
    grid.visit({at.x, at.y, at.z}, 1.5F * own, [&](const GridSample* s, std::size_t run) {
      for (const GridSample* const end = s + run; s != end; ++s) {
        const float dx = s->x - at.x;
        const float dy = s->y - at.y;
        const float dz = s->z - at.z;
        if (dx * dx + dy * dy + dz * dz > 2.25F * own * own || count >= 12) continue;
        sum += local_spacing(grid, *s, own);
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
  const std::size_t n = grid.samples().size();
  std::vector<float> spacing(n);
  std::vector<float> next(n);
  const auto each = [&](auto&& one) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, n, 512}, [&](const tbb::blocked_range<std::size_t>& range) {
      if (stop.stop_requested()) return;
      for (std::size_t i = range.begin(); i < range.end(); ++i) one(i);
    });
  };
  each([&](std::size_t i) { spacing[i] = local_spacing(grid, grid.samples()[i], guess); });
  for (int pass = 0; pass < 2; ++pass) {
    each([&](std::size_t i) { next[i] = averaged(grid, spacing, i); });
    spacing.swap(next);
  }
  if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled while measuring the spacing of the scan");
  return spacing;
}

}  // namespace telefab::scan
