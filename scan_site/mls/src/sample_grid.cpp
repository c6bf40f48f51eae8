#include "sample_grid.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace telefab::scan {

SampleGrid::SampleGrid(std::vector<GridSample> samples, const Vec3& origin, double cell_mm)
    : origin_{origin}, samples_{std::move(samples)} {
  Eigen::Vector3f high = Eigen::Vector3f::Zero();
  if (!samples_.empty()) {
    low_ = high = {samples_[0].x, samples_[0].y, samples_[0].z};
    for (const GridSample& s : samples_) {
      low_ = low_.cwiseMin(Eigen::Vector3f{s.x, s.y, s.z});
      high = high.cwiseMax(Eigen::Vector3f{s.x, s.y, s.z});
    }
  }
  // A cloud with a far outlier must not buy a column a micrometre: at most 4 columns a sample (and a million).
  const double most = std::max(1e6, 4.0 * static_cast<double>(samples_.size()));
  const double wide = static_cast<double>(high.x()) - low_.x();
  const double deep = static_cast<double>(high.y()) - low_.y();
  double cell = cell_mm;
  while ((wide / cell + 1) * (deep / cell + 1) > most || (high.z() - low_.z()) / cell > 1e9) cell *= 1.5;
  cell_ = static_cast<float>(cell);
  inverse_cell_ = 1 / cell_;
  nx_ = static_cast<int>((high.x() - low_.x()) * inverse_cell_) + 1;
  ny_ = static_cast<int>((high.y() - low_.y()) * inverse_cell_) + 1;

  const auto column = [&](const GridSample& s) {
    return static_cast<std::size_t>(column_of((s.y - low_.y()) * inverse_cell_, ny_)) * nx_ +
           column_of((s.x - low_.x()) * inverse_cell_, nx_);
  };
  const auto cell_z = [&](const GridSample& s) {
    return static_cast<std::int32_t>(std::floor((s.z - low_.z()) * inverse_cell_));
  };
  const std::size_t columns = static_cast<std::size_t>(nx_) * ny_;
  std::vector<std::uint32_t> start(columns + 1, 0);
  for (const GridSample& s : samples_) ++start[column(s) + 1];
  std::partial_sum(start.begin(), start.end(), start.begin());
  std::vector<GridSample> sorted(samples_.size());
  {
    std::vector<std::uint32_t> next(start.begin(), start.end() - 1);
    for (const GridSample& s : samples_) sorted[next[column(s)]++] = s;
  }
  samples_.swap(sorted);
  sorted = {};
  column_start_.resize(columns + 1);
  for (std::size_t c = 0; c < columns; ++c) {
    const auto first = samples_.begin() + start[c];
    const auto last = samples_.begin() + start[c + 1];
    // Every coordinate decides, so that the order of the file's points decides nothing.
    std::sort(first, last, [](const GridSample& a, const GridSample& b) {
      if (a.z != b.z) return a.z < b.z;
      if (a.y != b.y) return a.y < b.y;
      if (a.x != b.x) return a.x < b.x;
      if (a.nz != b.nz) return a.nz < b.nz;
      if (a.ny != b.ny) return a.ny < b.ny;
      return a.nx < b.nx;
    });
    column_start_[c] = static_cast<std::uint32_t>(cells_.size());
    for (auto s = first; s != last; ++s)
      if (s == first || cell_z(*s) != cells_.back().z)
        cells_.push_back({cell_z(*s), static_cast<std::uint32_t>(s - samples_.begin())});
  }
  column_start_[columns] = static_cast<std::uint32_t>(cells_.size());
  cells_.push_back({0, static_cast<std::uint32_t>(samples_.size())});
  cells_.shrink_to_fit();
}

}  // namespace telefab::scan
