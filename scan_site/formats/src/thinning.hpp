// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// What is read of points, each list as long as `points` or empty.
struct PointLists {
  std::vector<Vec3>& points;
  std::vector<Eigen::Vector3f>& normals;  ///< of any length; zero: none
  std::vector<float>& confidence;
  std::vector<float>& sheets_apart;

  /// Whether every list is as long as it may be: a record is complete.
  [[nodiscard]] bool are_level() const {
    const auto fits = [&](std::size_t size) { return size == 0 || size == points.size(); };
    return fits(normals.size()) && fits(confidence.size()) && fits(sheets_apart.size());
  }
  void copy(std::size_t from, std::size_t to);
  void resize(std::size_t count);
};

/// Keeps points of a stream that are as even as they come, so that any number of them needs the memory of a few: one
/// stays where no other of its side lies nearer than a reach, which grows whenever more than wanted are kept. What a
/// kept point stands for moves it along its normal to their mean, and turns the normal to theirs: noise falls as with
/// all of them, and where points lie on the surface stays as even. Same stream, same points, on any number of threads.
class Thinning {
 public:
  /// At most so many stay, or a few: four normals may oppose each other, and such points never stand for one another.
  explicit Thinning(std::size_t most) : most_{std::max<std::size_t>(most, 8)} {}

  /// Of the lists the first kept() are those of the last call; behind them stand others, of which some stay. All points
  /// are finite.
  void take_in(PointLists& lists);
  /// Moves the kept points to what they stand for. Behind the last take_in.
  void finish(PointLists& lists) const;

  [[nodiscard]] std::size_t kept() const { return means_.size(); }
  /// No two of a side are nearer; unit of the points. 0: nothing was thinned yet.
  [[nodiscard]] double reach() const { return reach_; }

 private:
  /// What a kept point stands for.
  struct Mean {
    float height = 0;  ///< over the kept point, along its own normal
    float count = 1;
    Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< sum
  };
  /// Cells of one reach, from a point that stays the same.
  using Cell = Eigen::Array3d;
  [[nodiscard]] Cell cell_of(const Vec3& p) const {
    constexpr double kFarthest = 1e18;  // what an integer holds; strays beyond it share cells, and are told apart there
    return ((p - from_) / reach_).array().floor().cwiseMax(-kFarthest).cwiseMin(kFarthest);
  }
  /// What each coordinate of a cell adds to its slot, and those of the cells about it: -1, 0 and +1 of each.
  struct AxisKeys {
    AxisKeys(const Cell& cell, int first) {
      const auto keys = [&](double coordinate, std::uint64_t factor) {
        std::array<std::uint64_t, 3> made{};
        // A point may lie farther from the others than whole numbers reach.
        const auto whole = static_cast<std::int64_t>(std::clamp(coordinate, -kFarCell, kFarCell));
        for (int i = 0; i < 3; ++i)
          made[static_cast<std::size_t>(i)] = static_cast<std::uint64_t>(whole + i - first) * factor;
        return made;
      };
      x = keys(cell.x(), 0x9E3779B97F4A7C15ULL);
      y = keys(cell.y(), 0xBF58476D1CE4E5B9ULL);
      z = keys(cell.z(), 0xD6E8FEB86659FD93ULL);
    }
    static constexpr double kFarCell = 1e18;
    std::array<std::uint64_t, 3> x, y, z;
  };
  [[nodiscard]] std::size_t slot_of(const Cell& cell) const;
  [[nodiscard]] std::size_t slot_of(const AxisKeys& keys, std::size_t x, std::size_t y, std::size_t z) const;
  /// A kept point of the same side within reach; kNone where there is none.
  [[nodiscard]] std::uint32_t near(const PointLists& lists, const Vec3& p, const Eigen::Vector3f& normal) const;
  void keep(const PointLists& lists, std::uint32_t at);
  static void stand_for(const PointLists& lists, std::uint32_t kept, std::size_t other, Mean& mean, const Mean& more);
  /// With another reach, of those that were kept.
  void begin_with(double reach, std::size_t room);
  void absorb(PointLists& lists, std::size_t first, std::vector<Mean> means);

  std::size_t most_;
  double reach_ = 0;
  Vec3 from_ = Vec3::Zero();
  std::vector<Mean> means_;           ///< one a kept point
  std::vector<std::uint32_t> first_;  ///< of a slot; kNone: empty. As many as a power of two
  std::vector<std::uint32_t> next_;   ///< one a kept point
};

}  // namespace telefab::scan
