// SPDX-License-Identifier: GPL-3.0-or-later
#include "follow.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/base/key_table.hpp>

#include "gap_fields.hpp"

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

/// Cells grow to the next level where the nearest sample is more than so many of its pitches away.
constexpr float kPitchesAway = 3;
/// Finest and coarsest cells: 1/4 and 1024 median spacings.
constexpr int kFinest = -2;
constexpr int kCoarsest = 10;
/// A virtual sample this near to the place beyond a rim, in spacings, has taken it up.
constexpr float kBesideRim = 1.5F;
/// What lies farther from the cloud's box than this part of its longest side is not followed.
constexpr float kBeyondBox = 0.3F;
/// About a gap all nodes are as far as the rim: their errors add up.
constexpr float kOpening = 3;
/// Crossing cells of a random plane, a pitch squared.
constexpr float kCellsAPitch = 1.5F;
/// How far off the object's surface samples lie, in parts of their gap (95 of 100 do not): between normals that agree
/// to within kAgreed and others,
constexpr float kAgreed = 0.95F, kErrorAgreed = 0.25F, kErrorDisagreed = 0.4F;
/// and on smooth functions, by how far two opinions are apart. Where such a function is flat, as between sheets that it
/// hardly parts, what it is off moves its zero set farther.
constexpr float kLeastErrorShare = 0.08F, kOpinions = 2, kMostErrorShare = 0.4F;
/// Steps onto the zero set of a smooth function.
constexpr int kNewton = 3;

/// A cell or corner: its level, and how many pitches of that level it lies from the low corner of the region.
struct Place {
  int level = 0;
  std::array<std::int32_t, 3> at{};
};
constexpr std::int32_t kMostCells = (1 << 19) - 1;

std::uint64_t key_of(const Place& p) {
  return static_cast<std::uint64_t>(p.level - kFinest) << 57U | static_cast<std::uint64_t>(p.at[2]) << 38U |
         static_cast<std::uint64_t>(p.at[1]) << 19U | static_cast<std::uint64_t>(p.at[0]);
}
/// Places near each other get numbers near each other: by blocks of four, then inside of them.
std::uint64_t rank_of(const Place& p) {
  auto rank = static_cast<std::uint64_t>(p.level - kFinest);
  for (const std::size_t axis : {2U, 1U, 0U}) rank = rank << 17U | static_cast<std::uint64_t>(p.at[axis] >> 2);
  for (const std::size_t axis : {2U, 1U, 0U}) rank = rank << 2U | static_cast<std::uint64_t>(p.at[axis] & 3);
  return rank;
}
Place place_of(std::uint64_t rank) {
  Place p;
  for (const std::size_t axis : {0U, 1U, 2U}) {
    const std::uint64_t inside = rank >> 2 * axis & 3U, block = rank >> (6 + 17 * axis) & 0x1ffffU;
    p.at[axis] = static_cast<std::int32_t>(block << 2U | inside);
  }
  p.level = static_cast<int>(rank >> 57U) + kFinest;
  return p;
}
/// What lies beyond the numbers lies outside of every region, and is left out.
void sort_unique(std::vector<Place>& places) {
  std::vector<std::uint64_t> ranks;
  ranks.reserve(places.size());
  for (const Place& p : places)
    if (*std::max_element(p.at.begin(), p.at.end()) <= kMostCells) ranks.push_back(rank_of(p));
  std::sort(ranks.begin(), ranks.end());
  ranks.erase(std::unique(ranks.begin(), ranks.end()), ranks.end());
  places.clear();
  for (const std::uint64_t rank : ranks) places.push_back(place_of(rank));
}

/// What is known at a corner of the cells.
struct Corner {
  float value = 0;
  float agreement = 0;
};

class Follower {
 public:
  Follower(const MeasuredSide& measured, const RimReach& reach, float most_gap, const GapFields* smooth,
           Completion& completion)
      : measured_{measured},
        smooth_{smooth},
        reach_{reach},
        most_gap_{most_gap},
        completion_{completion},
        runs_away_(smooth ? smooth->count() : 0, false) {
    std::vector<Vector3f> before;
    for (const VirtualSample& s : completion.samples) before.push_back(s.point);
    if (!before.empty()) before_ = std::make_unique<KdTree>(before);
    low_ = high_ = measured.points[0];
    for (const Vector3f& p : measured.points) {
      low_ = low_.cwiseMin(p);
      high_ = high_.cwiseMax(p);
    }
    const float beyond = kBeyondBox * (high_ - low_).maxCoeff();
    low_ -= Vector3f::Constant(beyond);
    high_ += Vector3f::Constant(beyond);
  }

  void seed(const Rim& rim) { frontier_.push_back(cell_at(rim.probe, base_level(measured_.spacings[rim.sample]))); }
  /// All cells about the probe: where the surface bends away from the plane of the rim.
  void seed_widely(const Rim& rim) {
    const Place middle = cell_at(rim.probe, base_level(measured_.spacings[rim.sample]));
    for (int z = -1; z <= 1; ++z)
      for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x)
          frontier_.push_back({middle.level, {middle.at[0] + x, middle.at[1] + y, middle.at[2] + z}});
  }
  /// The rims beside which no virtual sample lies yet.
  [[nodiscard]] std::vector<Rim> rims_without_samples(std::span<const Rim> rims) const {
    std::vector<Vector3f> points;
    for (const VirtualSample& s : completion_.samples) points.push_back(s.point);
    const KdTree near{points};
    std::vector<Rim> left;
    for (const Rim& rim : rims) {
      const float reach = kBesideRim * measured_.spacings[rim.sample];
      if (points.empty() || near.nearest(rim.probe).squared_distance > reach * reach) left.push_back(rim);
    }
    return left;
  }

  /// Gaps whose function does not close them; their samples are taken back.
  std::vector<bool> take_back() {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < completion_.samples.size(); ++i)
      if (!runs_away_[gap_of_sample_[i]]) completion_.samples[kept++] = completion_.samples[i];
    completion_.samples.resize(kept);
    return runs_away_;
  }

  /// One wave: every cell of the frontier is looked at, and hands on to its neighbours. False: nothing is left.
  bool step() {
    sort_unique(frontier_);
    std::erase_if(frontier_, [&](const Place& p) { return !seen_.number(key_of(p)).second; });
    if (frontier_.empty()) return false;
    std::vector<Place> cells = sized_cells();
    value_corners(cells);
    for (const Place& cell : cells) look_at(cell);
    return true;
  }

 private:
  [[nodiscard]] float pitch(int level) const { return std::ldexp(measured_.spacing, level); }
  [[nodiscard]] int base_level(float spacing) const {
    const float finer = std::max(spacing / measured_.spacing, 1e-3F);
    return std::clamp(static_cast<int>(std::lround(std::log2(finer))), kFinest, kCoarsest);
  }
  [[nodiscard]] Place cell_at(const Vector3f& p, int level) const {
    const Eigen::Array3f at = (p - low_).array() / pitch(level);
    Place cell{level, {}};
    for (std::size_t i = 0; i < 3; ++i)
      cell.at[i] =
          std::clamp(static_cast<std::int32_t>(std::floor(at[static_cast<Eigen::Index>(i)])), 1, kMostCells - 1);
    return cell;
  }
  [[nodiscard]] Vector3f position(const Place& p, float offset = 0) const {
    return low_ + pitch(p.level) * Vector3f{static_cast<float>(p.at[0]) + offset, static_cast<float>(p.at[1]) + offset,
                                            static_cast<float>(p.at[2]) + offset};
  }
  static Place corner_of(const Place& cell, unsigned corner) {
    return {cell.level,
            {cell.at[0] + static_cast<int>(corner & 1U), cell.at[1] + static_cast<int>(corner >> 1U & 1U),
             cell.at[2] + static_cast<int>(corner >> 2U)}};
  }
  [[nodiscard]] bool in_region(const Place& cell) const {
    const Vector3f p = position(cell, 0.5F);
    return (p.array() > low_.array()).all() && (p.array() < high_.array()).all() &&
           *std::min_element(cell.at.begin(), cell.at.end()) > 0 &&
           *std::max_element(cell.at.begin(), cell.at.end()) < kMostCells;
  }

  /// The level that the distance of the nearest sample from the middle of a cell asks for, and that distance.
  struct Demand {
    int level = 0;
    float gap = 0;
  };
  [[nodiscard]] Demand demand_at(const Place& cell) const {
    const Neighbour nearest = measured_.near.nearest(position(cell, 0.5F));
    Demand demand{base_level(measured_.spacings[nearest.index]), std::sqrt(nearest.squared_distance)};
    while (demand.level < kCoarsest && demand.gap > kPitchesAway * pitch(demand.level + 1)) ++demand.level;
    return demand;
  }
  static Place parent_of(const Place& cell) {
    return {cell.level + 1, {cell.at[0] >> 1, cell.at[1] >> 1, cell.at[2] >> 1}};
  }

  /// The cells of the frontier that have the size their distance from the samples asks for; for the others those of
  /// the right size go to the next frontier. A cell is parted exactly where its own middle asks for smaller ones, so
  /// that parent and child never send to each other what neither takes.
  std::vector<Place> sized_cells() {
    enum class Fate : std::uint8_t { Outside, TooWide, Kept, Parted, Joined };
    std::vector<Fate> fates(frontier_.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, frontier_.size(), 64}, [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        const Place& cell = frontier_[i];
        const Demand demand = demand_at(cell);
        if (!in_region(cell))
          fates[i] = Fate::Outside;
        else if (demand.gap > most_gap_)
          fates[i] = Fate::TooWide;
        else if (demand.level < cell.level)
          fates[i] = Fate::Parted;
        else if (cell.level < kCoarsest && demand_at(parent_of(cell)).level > cell.level)
          fates[i] = Fate::Joined;
        else
          fates[i] = Fate::Kept;
      }
    });
    std::vector<Place> cells;
    std::vector<Place> resized;
    for (std::size_t i = 0; i < frontier_.size(); ++i) {
      const Place& cell = frontier_[i];
      if (fates[i] == Fate::TooWide) give_up_at(position(cell, 0.5F));
      if (fates[i] == Fate::Kept) cells.push_back(cell);
      if (fates[i] == Fate::Joined) resized.push_back(parent_of(cell));
      if (fates[i] != Fate::Parted) continue;
      const Place half{cell.level - 1, {2 * cell.at[0], 2 * cell.at[1], 2 * cell.at[2]}};
      for (unsigned c = 0; c < 8; ++c) resized.push_back(corner_of(half, c));
    }
    frontier_ = std::move(resized);
    return cells;
  }

  void value_corners(const std::vector<Place>& cells) {
    std::vector<Place> missing;
    for (const Place& cell : cells)
      for (unsigned c = 0; c < 8; ++c)
        if (const Place corner = corner_of(cell, c); corner_numbers_.known(key_of(corner)) == KeyTable::kNone)
          missing.push_back(corner);
    sort_unique(missing);
    std::vector<Vector3f> places;
    places.reserve(missing.size());
    for (const Place& corner : missing) places.push_back(position(corner));
    const std::vector<Corner> found = smooth_ ? smooth_values(places) : common_values(places);
    for (const Place& corner : missing) corner_numbers_.number(key_of(corner));
    corners_.insert(corners_.end(), found.begin(), found.end());
  }

  [[nodiscard]] std::vector<Corner> smooth_values(std::span<const Vector3f> places) const {
    std::vector<Corner> found(places.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, places.size(), 64}, [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i)
        found[i] = {smooth_->value(smooth_->gap_at(places[i]), places[i]).value, 1};
    });
    return found;
  }

  [[nodiscard]] std::vector<Corner> common_values(std::span<const Vector3f> places) const {
    const std::vector<WideField> fields = measured_.tree.wides(places, kOpening);
    std::vector<Corner> found(places.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, places.size(), 256}, [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        // Where the samples disagree about the direction, the winding number decides: it closes what is open, and is
        // bounded.
        const float gap = std::sqrt(measured_.near.nearest(places[i]).squared_distance);
        const float side = 2 * gap * (0.5F - fields[i].winding);
        const float m = fields[i].agreement;
        found[i] = {m * fields[i].value + (1 - m) * side, m};
      }
    });
    return found;
  }

  void look_at(const Place& cell) {
    std::array<Corner, 8> corner;
    for (unsigned c = 0; c < 8; ++c) corner[c] = corners_[corner_numbers_.known(key_of(corner_of(cell, c)))];
    Vector3f sum = Vector3f::Zero();
    float count = 0, agreement = 0;
    for (unsigned c = 0; c < 8; ++c) {
      agreement += corner[c].agreement / 8;
      for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned other = c | 1U << axis;
        if (other == c || (corner[c].value < 0) == (corner[other].value < 0)) continue;
        Vector3f at{static_cast<float>(c & 1U), static_cast<float>(c >> 1U & 1U), static_cast<float>(c >> 2U)};
        at[static_cast<Eigen::Index>(axis)] = corner[c].value / (corner[c].value - corner[other].value);
        sum += at;
        count += 1;
      }
    }
    if (count == 0) return;
    const Vector3f inside = sum / count;
    Vector3f point = position(cell) + pitch(cell.level) * inside;
    Vector3f normal = gradient(corner, inside);
    float slope = 1;  // of the smooth function
    std::size_t own_gap = 0;
    if (smooth_) {
      own_gap = smooth_->gap_at(point);
      for (int i = 0; i < kNewton; ++i) {
        const HermiteField::Value at = smooth_->value(own_gap, point);
        const float steep2 = at.gradient.squaredNorm();
        if (!(steep2 > 0)) return;
        normal = at.gradient;
        slope = at.slope();
        const float limit = pitch(cell.level) / 2;
        const Vector3f step = at.value / steep2 * at.gradient;
        point -= step.norm() > limit ? Vector3f{limit / step.norm() * step} : step;
      }
    } else if (before_ && before_->nearest(point).squared_distance < pitch(cell.level) * pitch(cell.level)) {
      return;
    }
    const Neighbour nearest = measured_.near.nearest(point);
    const float gap = std::sqrt(nearest.squared_distance);
    if (gap <= reach_.covered * measured_.spacings[nearest.index] || !(normal.norm() > 0)) return;
    if (smooth_ && gap > smooth_->farthest(own_gap)) return give_up_at(point);
    VirtualSample sample;
    sample.point = point;
    sample.normal = normal.normalized();
    sample.gap = gap;
    sample.spacing = pitch(cell.level) / std::sqrt(kCellsAPitch);
    sample.smooth = smooth_ != nullptr;
    if (smooth_)
      sample.error_share = std::min(kMostErrorShare, kLeastErrorShare / std::min(slope, 1.F) +
                                                         kOpinions * smooth_->opinions(own_gap, point) / gap);
    else
      sample.error_share = agreement > kAgreed ? kErrorAgreed : kErrorDisagreed;
    gap_of_sample_.push_back(own_gap);
    completion_.samples.push_back(sample);
    hand_on(cell, corner);
  }

  /// The surface goes on farther than a gap may be wide.
  void give_up_at(const Vector3f& place) {
    if (smooth_)
      runs_away_[smooth_->gap_at(place)] = true;
    else
      completion_.too_wide = true;
  }

  void hand_on(const Place& cell, const std::array<Corner, 8>& corner) {
    for (unsigned axis = 0; axis < 3; ++axis)
      for (unsigned side = 0; side < 2; ++side) {
        bool inside = false, outside = false;
        for (unsigned c = 0; c < 8; ++c)
          if ((c >> axis & 1U) == side) (corner[c].value < 0 ? inside : outside) = true;
        if (!inside || !outside) continue;
        Place next = cell;
        next.at[axis] += side == 1 ? 1 : -1;
        frontier_.push_back(next);
      }
  }

  /// Of the values between the corners, at a place in the unit cell.
  static Vector3f gradient(const std::array<Corner, 8>& corner, const Vector3f& at) {
    Vector3f sum = Vector3f::Zero();
    for (unsigned c = 0; c < 8; ++c) {
      Vector3f share;
      Vector3f slope;
      for (unsigned axis = 0; axis < 3; ++axis) {
        const auto i = static_cast<Eigen::Index>(axis);
        const bool far = (c >> axis & 1U) != 0;
        share[i] = far ? at[i] : 1 - at[i];
        slope[i] = far ? 1.F : -1.F;
      }
      sum += corner[c].value * Vector3f{slope.x() * share.y() * share.z(), share.x() * slope.y() * share.z(),
                                        share.x() * share.y() * slope.z()};
    }
    return sum;
  }

  const MeasuredSide& measured_;
  const GapFields* smooth_;  ///< none: what all samples tell together
  RimReach reach_;
  float most_gap_;
  Completion& completion_;
  Vector3f low_, high_;
  std::vector<Place> frontier_;
  KeyTable seen_;
  KeyTable corner_numbers_;
  std::vector<Corner> corners_;
  std::unique_ptr<KdTree> before_;          ///< samples that were there before
  std::vector<bool> runs_away_;             ///< gaps whose function does not close them
  std::vector<std::size_t> gap_of_sample_;  ///< of those found
};

}  // namespace

Result<void> follow_surface(const MeasuredSide& measured, std::span<const Rim> rims, const RimReach& reach,
                            float most_gap, std::size_t most_samples, Completion& completion,
                            const ProgressSink& progress, std::stop_token stop) {
  const auto follow = [&](Follower& follower) -> Result<void> {
    while (follower.step()) {
      if (stop.stop_requested()) return cancelled("closing gaps of the scan");
      if (completion.samples.size() > most_samples) {
        completion.too_many = true;
        break;
      }
      report(progress, WorkStage::ClosingGaps,
             static_cast<double>(completion.samples.size()) / static_cast<double>(most_samples));
    }
    return {};
  };
  const auto from = [&](Follower& follower, std::span<const Rim> seeds) -> Result<void> {
    for (const Rim& rim : seeds) follower.seed(rim);
    if (auto ok = follow(follower); !ok || completion.too_many) return ok;
    for (const Rim& rim : follower.rims_without_samples(seeds)) follower.seed_widely(rim);
    return follow(follower);
  };
  auto smooth = GapFields::about(measured, rims, stop);
  if (!smooth) return tl::unexpected{smooth.error()};
  if (const auto seeds = smooth->rims(true); !seeds.empty()) {
    Follower follower{measured, reach, most_gap, &*smooth, completion};
    if (auto ok = from(follower, seeds); !ok) return ok;
    smooth->drop(follower.take_back());
  }
  Follower follower{measured, reach, most_gap, nullptr, completion};
  if (auto ok = from(follower, follower.rims_without_samples(smooth->rims(false))); !ok) return ok;
  if (completion.samples.size() > most_samples) completion.samples.resize(most_samples);
  return {};
}

}  // namespace telefab::scan
