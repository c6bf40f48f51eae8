#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan {

/// A sample as the grid stores it: relative to the grid's origin, millimetres.
struct GridSample {
  float x, y, z;
  float width;  ///< kernel width h of this sample
  float nx, ny, nz;
};

/// Samples sorted into square columns over x and y, within a column into cells along z. Only occupied cells take
/// memory. Immutable.
class SampleGrid {
 public:
  /// `samples` are relative to `origin`; `cell_mm` > 0 is enlarged where columns would outnumber samples by far.
  SampleGrid(std::vector<GridSample> samples, const Vec3& origin, double cell_mm);

  [[nodiscard]] const std::vector<GridSample>& samples() const { return samples_; }
  [[nodiscard]] const Vec3& origin() const { return origin_; }

  /// Calls take(const GridSample*, count) for runs that hold every sample within radius of the centre (relative to
  /// the origin), and some farther ones.
  template <class Take>
  void visit(const Eigen::Vector3f& centre, float radius, Take&& take) const {
    const int x0 = column_of((centre.x() - radius - low_.x()) * inverse_cell_, nx_);
    const int x1 = column_of((centre.x() + radius - low_.x()) * inverse_cell_, nx_);
    const int y0 = column_of((centre.y() - radius - low_.y()) * inverse_cell_, ny_);
    const int y1 = column_of((centre.y() + radius - low_.y()) * inverse_cell_, ny_);
    for (int j = y0; j <= y1; ++j) {
      const float dy = outside(centre.y(), low_.y() + static_cast<float>(j) * cell_);
      for (int i = x0; i <= x1; ++i) {
        const float dx = outside(centre.x(), low_.x() + static_cast<float>(i) * cell_);
        const float left = radius * radius - dx * dx - dy * dy;
        if (left < 0) continue;
        const std::size_t column = static_cast<std::size_t>(j) * nx_ + i;
        const std::uint32_t first = column_start_[column];
        const std::uint32_t last = column_start_[column + 1];
        if (first == last) continue;
        const float reach = std::sqrt(left);
        const int z0 = static_cast<int>(std::floor((centre.z() - reach - low_.z()) * inverse_cell_));
        const int z1 = static_cast<int>(std::floor((centre.z() + reach - low_.z()) * inverse_cell_));
        std::uint32_t a = first;
        std::uint32_t b = last;
        while (a < b) {
          const std::uint32_t middle = (a + b) / 2;
          if (cells_[middle].z < z0)
            a = middle + 1;
          else
            b = middle;
        }
        std::uint32_t end = a;
        while (end < last && cells_[end].z <= z1) ++end;
        if (end > a) take(samples_.data() + cells_[a].first, cells_[end].first - cells_[a].first);
      }
    }
  }

 private:
  struct Cell {
    std::int32_t z;
    std::uint32_t first;  ///< index into samples_
  };
  [[nodiscard]] static int column_of(float at, int count) {
    return at <= 0 ? 0 : at >= static_cast<float>(count) ? count - 1 : static_cast<int>(at);
  }
  [[nodiscard]] float outside(float at, float low) const {
    return at < low ? low - at : at > low + cell_ ? at - low - cell_ : 0.F;
  }

  Vec3 origin_;
  Eigen::Vector3f low_ = Eigen::Vector3f::Zero();
  float cell_ = 1;
  float inverse_cell_ = 1;
  int nx_ = 1;
  int ny_ = 1;
  std::vector<GridSample> samples_;
  std::vector<std::uint32_t> column_start_;  ///< index into cells_, one more than columns
  std::vector<Cell> cells_;  ///< one more than occupied, so that the next cell's start is this one's end
};

}  // namespace telefab::scan
