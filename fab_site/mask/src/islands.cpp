#include <algorithm>
#include <numeric>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {
namespace {

/// Disjoint sets over run numbers; the smallest number leads its set, so results do not depend on the order of unions.
class Sets {
 public:
  explicit Sets(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), std::size_t{0}); }
  std::size_t leader(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void unite(std::size_t a, std::size_t b) {
    a = leader(a);
    b = leader(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::size_t> parent_;
};

/// Calls `visit(i, j)` for every pair of a run of `a` and a run of `b` in rows `row_step` apart (a's row + row_step =
/// b's row) whose columns overlap when widened by `reach` pixels.
template <class Visit>
void for_pairs(std::span<const PixelRun> a, std::span<const PixelRun> b, std::uint32_t row_step, std::uint32_t reach,
               const Visit& visit) {
  std::size_t start = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::uint32_t row = a[i].row + row_step;
    while (start < b.size() && (b[start].row < row || (b[start].row == row && b[start].end + reach <= a[i].first)))
      ++start;
    for (std::size_t j = start; j < b.size() && b[j].row == row && b[j].first < a[i].end + reach; ++j) visit(i, j);
  }
}

}  // namespace

std::vector<PixelRun> cured_runs(const Mask& mask, std::uint8_t threshold) {
  std::vector<PixelRun> runs;
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y) {
    const auto row = std::span{mask.rows}.subspan(std::size_t{y} * mask.size.width_px, mask.size.width_px);
    const auto is_cured = [&](std::uint8_t level) { return level >= threshold; };
    for (auto at = row.begin(); (at = std::find_if(at, row.end(), is_cured)) != row.end();) {
      const auto end = std::find_if_not(at, row.end(), is_cured);
      runs.push_back({y, static_cast<std::uint32_t>(at - row.begin()), static_cast<std::uint32_t>(end - row.begin())});
      at = end;
    }
  }
  return runs;
}

std::vector<Island> unsupported_islands(std::span<const PixelRun> runs, std::span<const PixelRun> below,
                                        std::uint64_t min_area_px) {
  Sets patches{runs.size()};
  for_pairs(runs, runs, 1, 1, [&](std::size_t i, std::size_t j) { patches.unite(i, j); });
  std::vector<bool> held(runs.size(), false);
  for_pairs(runs, below, 0, 0, [&](std::size_t i, std::size_t) { held[i] = true; });

  struct Sum {
    std::uint64_t area = 0;
    double x = 0;
    double y = 0;
    bool held = false;
  };
  std::vector<Sum> sums(runs.size());
  for (std::size_t i = 0; i < runs.size(); ++i) {
    Sum& sum = sums[patches.leader(i)];
    const double length = runs[i].end - runs[i].first;
    sum.area += runs[i].end - runs[i].first;
    sum.x += length * (runs[i].first + runs[i].end) / 2.0;
    sum.y += length * (runs[i].row + 0.5);
    sum.held = sum.held || held[i];
  }
  std::vector<Island> islands;
  for (const Sum& sum : sums)
    if (sum.area >= std::max<std::uint64_t>(min_area_px, 1) && !sum.held)
      islands.push_back({sum.area, sum.x / static_cast<double>(sum.area), sum.y / static_cast<double>(sum.area)});
  return islands;
}

}  // namespace telefab::fab
