// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/kd_tree.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nanoflann.hpp>

namespace telefab::scan {
namespace {

struct Points {
  std::vector<Eigen::Vector3f> at;
  [[nodiscard]] std::size_t kdtree_get_point_count() const { return at.size(); }
  [[nodiscard]] float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return at[i][static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box& /*box*/) const {
    return false;
  }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3, std::uint32_t>;

/// The k nearest so far, kept in order in the caller's own array.
class NearestSet {
 public:
  using DistanceType = float;
  explicit NearestSet(std::span<Neighbour> found) : found_{found} {}
  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] bool full() const { return count_ == found_.size(); }
  [[nodiscard]] float worstDist() const {
    return full() ? found_[count_ - 1].squared_distance : std::numeric_limits<float>::max();
  }
  bool addPoint(float squared_distance, std::uint32_t index) {
    if (full() && squared_distance >= worstDist()) return true;  // the search looks at the worst once a leaf
    std::size_t at = full() ? count_ - 1 : count_++;
    for (; at > 0 && found_[at - 1].squared_distance > squared_distance; --at) found_[at] = found_[at - 1];
    found_[at] = {index, squared_distance};
    return true;
  }

 private:
  std::span<Neighbour> found_;
  std::size_t count_ = 0;
};

/// The nearest within a bound, which lets the search leave out all that lies farther from the start.
class NearestWithin {
 public:
  using DistanceType = float;
  explicit NearestWithin(float squared_reach)
      : bound_{std::nextafter(squared_reach, std::numeric_limits<float>::max())} {}
  [[nodiscard]] std::size_t size() const { return found_ ? 1 : 0; }
  [[nodiscard]] bool full() const { return true; }
  [[nodiscard]] float worstDist() const { return bound_; }
  bool addPoint(float squared_distance, std::uint32_t index) {
    if (squared_distance >= bound_) return true;
    bound_ = squared_distance;
    found_ = Neighbour{index, squared_distance};
    return true;
  }
  [[nodiscard]] const std::optional<Neighbour>& found() const { return found_; }

 private:
  float bound_;
  std::optional<Neighbour> found_;
};

}  // namespace

struct KdTree::Index {
  explicit Index(std::span<const Eigen::Vector3f> from)
      : points{{from.begin(), from.end()}}, tree{3, points, nanoflann::KDTreeSingleIndexAdaptorParams{12}} {}
  Points points;
  Tree tree;
};

KdTree::KdTree(std::span<const Eigen::Vector3f> points) : index_{std::make_unique<Index>(points)} {}
KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

std::size_t KdTree::size() const { return index_->points.at.size(); }

const Eigen::Vector3f& KdTree::point(std::uint32_t index) const { return index_->points.at[index]; }

std::size_t KdTree::nearest(const Eigen::Vector3f& query, std::span<Neighbour> found) const {
  if (found.empty() || size() == 0) return 0;
  NearestSet set{found};
  index_->tree.findNeighbors(set, query.data(), nanoflann::SearchParams{});
  return set.size();
}

Neighbour KdTree::nearest(const Eigen::Vector3f& query) const {
  Neighbour found;
  nearest(query, {&found, 1});
  return found;
}

std::optional<Neighbour> KdTree::nearest_within(const Eigen::Vector3f& query, float reach) const {
  if (size() == 0) return std::nullopt;
  NearestWithin set{reach * reach};
  index_->tree.findNeighbors(set, query.data(), nanoflann::SearchParams{});
  return set.found();
}

std::vector<Neighbour> KdTree::within(const Eigen::Vector3f& query, float radius) const {
  std::vector<std::pair<std::uint32_t, float>> matches;
  index_->tree.radiusSearch(query.data(), radius * radius, matches, nanoflann::SearchParams{});
  std::vector<Neighbour> found;
  found.reserve(matches.size());
  for (const auto& [index, squared] : matches) found.push_back({index, squared});
  return found;
}

std::span<const std::uint32_t> KdTree::leaf_order() const { return index_->tree.vAcc; }

}  // namespace telefab::scan
