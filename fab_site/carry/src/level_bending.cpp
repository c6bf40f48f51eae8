// SPDX-License-Identifier: GPL-3.0-or-later
#include "level_bending.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <telefab/base/disjoint_sets.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kNone = ~std::uint32_t{0};

/// Pieces that hang together in the layers from some level to the moment's.
struct Group {
  double area = 0, x = 0, y = 0;  ///< pulled area, with what weighs as much, and its moments
  double best = 0;                ///< stress of the worst level so far
  std::uint32_t section = kNone;
  Pull pull;  ///< at it
};

/// Sums over the sections of a group at one level.
struct Level {
  double area = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  double low_x = std::numeric_limits<double>::infinity(), high_x = -low_x, low_y = low_x, high_y = -low_x;
  std::vector<std::uint32_t> sections;
};

class Descent {
 public:
  Descent(const LoadPath& path, std::uint32_t moment, double sideways, double least, const LevelFloors& floors)
      : path_{path},
        moment_{moment},
        sideways_{sideways},
        least_{least},
        floors_{floors},
        sets_{count_of(path, moment)} {
    const std::uint32_t first = path.first_piece(moment);
    label_.assign(path.first_piece(moment + 1) - first, kNone);
    for (std::uint32_t p = first; p < path.first_piece(moment + 1); ++p) {
      const Piece& piece = path.pieces()[p];
      if (piece.pulled == 0) continue;
      label_[p - first] = static_cast<std::uint32_t>(groups_.size());
      const double area = path.pull_mm2(piece.pulled);
      groups_.push_back({area, area * piece.pulled_at.x_mm, area * piece.pulled_at.y_mm, 0, kNone, {}});
      hang(groups_.back(), piece);
    }
    levels_.resize(groups_.size());
  }

  WorstLevels run() {
    for (std::uint32_t level = moment_; level > 0 && !groups_.empty(); --level) {
      gather(level);
      for (const std::uint32_t g : touched_) judge(g, level);
      descend(level);
    }
    for (Group& group : groups_) put_down(group);
    return std::move(worst_);
  }

 private:
  static std::size_t count_of(const LoadPath& path, std::uint32_t moment) {
    return path.first_piece(moment + 1) - path.first_piece(moment);
  }

  /// A piece's weight, as so much area is pulled.
  void hang(Group& group, const Piece& piece) const {
    const double area = path_.weight_of(piece) * path_.pixel_mm2() / kPullUnits;
    group.area += area, group.x += area * piece.middle.x_mm, group.y += area * piece.middle.y_mm;
  }

  void gather(std::uint32_t level) {
    touched_.clear();
    const std::uint32_t first = path_.first_piece(level);
    for (std::uint32_t s = path_.first_section(level); s < path_.first_section(level + 1); ++s) {
      const Section& section = path_.sections()[s];
      const std::uint32_t label = label_[section.upper - first];
      if (label == kNone || !path_.stands(section.lower)) continue;
      const std::uint32_t g = sets_.root(label);
      Level& l = levels_[g];
      if (l.area == 0) touched_.push_back(g);
      const double a = section.area_mm2, x = section.middle.x_mm, y = section.middle.y_mm;
      l.area += a, l.x += a * x, l.y += a * y;
      l.xx += a * (x * x + section.xx), l.xy += a * (x * y + section.xy), l.yy += a * (y * y + section.yy);
      l.low_x = std::min(l.low_x, x - section.reach_mm[4]), l.high_x = std::max(l.high_x, x + section.reach_mm[0]);
      l.low_y = std::min(l.low_y, y - section.reach_mm[6]), l.high_y = std::max(l.high_y, y + section.reach_mm[2]);
      l.sections.push_back(s);
    }
  }

  void judge(std::uint32_t g, std::uint32_t level) {
    Group& group = groups_[g];
    Level& l = levels_[g];
    const Point2 at{group.x / group.area, group.y / group.area};
    const double x = l.x / l.area, y = l.y / l.area;
    const double xx = l.xx / l.area - x * x, xy = l.xy / l.area - x * y, yy = l.yy / l.area - y * y;
    const double det = xx * yy - xy * xy;
    const double mx = at.x_mm - x, my = at.y_mm - y, mean = group.area / l.area;
    const double below = (moment_ - level + 1) * path_.thickness_mm();
    // No rim reaches beyond the corners of the box.
    double most = 0;
    const double side_x = std::max(l.high_x - x, x - l.low_x), side_y = std::max(l.high_y - y, y - l.low_y);
    if (det > 0) {
      const double tx = (yy * mx - xy * my) / det, ty = (xx * my - xy * mx) / det;
      most = side_x * std::abs(tx) + side_y * std::abs(ty);
      if (sideways_ > 0)
        most += sideways_ * below * (side_x * (yy + std::abs(xy)) + side_y * (xx + std::abs(xy))) / det;
    }
    const double floor = std::max(group.best, group.area >= least_ ? floors_.large : floors_.small);
    if (det <= 0 || mean * (1 + most) > floor) {
      parts_.clear();
      for (const std::uint32_t s : l.sections) {
        const Section& section = path_.sections()[s];
        parts_.push_back({&section, section.area_mm2, below});
      }
      const Pull pull{group.area, at, sideways_};
      const CutStress stress = stress_of(parts_, pull);
      if (stress.bending > floor) {
        group.best = stress.bending;
        group.section = l.sections[stress.bending_at];
        group.pull = pull;
      }
    }
    l.area = l.x = l.y = l.xx = l.xy = l.yy = 0;
    l.low_x = l.low_y = std::numeric_limits<double>::infinity();
    l.high_x = l.high_y = -l.low_x;
    l.sections.clear();
  }

  /// To the pieces of the next layer below, joining groups that meet in one of them.
  void descend(std::uint32_t level) {
    const std::uint32_t first = path_.first_piece(level), below = path_.first_piece(level - 1);
    std::vector<std::uint32_t> next(first - below, kNone);
    for (std::uint32_t s = path_.first_section(level); s < path_.first_section(level + 1); ++s) {
      const Section& section = path_.sections()[s];
      const std::uint32_t label = label_[section.upper - first];
      if (label == kNone) continue;
      std::uint32_t& lower = next[section.lower - below];
      if (lower == kNone) {
        lower = sets_.root(label);
        hang(groups_[lower], path_.pieces()[section.lower]);
      } else {
        join(lower, label);
      }
    }
    label_ = std::move(next);
  }

  void join(std::uint32_t a, std::uint32_t b) {
    a = sets_.root(a), b = sets_.root(b);
    if (a == b) return;
    sets_.join(a, b);
    const std::uint32_t keep = sets_.root(a), gone = keep == a ? b : a;
    Group& all = groups_[keep];
    all.area += groups_[gone].area, all.x += groups_[gone].x, all.y += groups_[gone].y;
    // What was the worst of either alone is no measure for both.
    put_down(all);
    put_down(groups_[gone]);
  }

  void put_down(Group& group) {
    if (group.section != kNone)
      (group.pull.area_mm2 >= least_ ? worst_.large : worst_.small).push_back({group.section, group.best, group.pull});
    group.section = kNone;
    group.best = 0;
  }

  const LoadPath& path_;
  std::uint32_t moment_;
  double sideways_, least_;
  LevelFloors floors_;
  DisjointSets sets_;
  std::vector<std::uint32_t> label_;  ///< by piece of the layer, any member of its group
  std::vector<Group> groups_;
  WorstLevels worst_;
  std::vector<Level> levels_;
  std::vector<std::uint32_t> touched_;
  std::vector<CutPart> parts_;
};

}  // namespace

WorstLevels worst_levels(const LoadPath& path, std::uint32_t moment, double sideways_share, double least_held_mm2,
                         const LevelFloors& floors) {
  return Descent{path, moment, sideways_share, least_held_mm2, floors}.run();
}

}  // namespace telefab::fab
