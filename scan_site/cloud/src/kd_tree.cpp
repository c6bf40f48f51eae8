// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/kd_tree.hpp>

#include <tbb/parallel_invoke.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace telefab::scan {
namespace {

using Distances = std::array<float, 3>;

constexpr std::uint32_t kLeafSize = 12;
/// Leaves are looked at so many points at a time.
constexpr std::uint32_t kLanes = 4;
/// Halves with more points are parted side by side.
constexpr std::uint32_t kLargePart = 8192;

/// Two halves on either side of a gap along an axis, or a leaf. In the order of a walk that goes to the low half first,
/// which therefore follows its parent.
struct Node {
  float low = 0, high = 0;  ///< the gap: the last place of the low half, the first of the high one
  std::uint32_t first = 0;  ///< of a leaf: its first point; else the high half's node
  std::uint16_t count = 0;  ///< of a leaf: its points; else 0
  std::uint16_t axis = 0;
};

struct Box {
  Distances low, high;
};

/// A point while the tree is made.
struct Entry {
  Distances at;
  std::uint32_t index;
};

Box box_of(std::span<const Entry> part) {
  Box box{part[0].at, part[0].at};
  for (const Entry& e : part)
    for (std::size_t a = 0; a < 3; ++a) {
      box.low[a] = std::min(box.low[a], e.at[a]);
      box.high[a] = std::max(box.high[a], e.at[a]);
    }
  return box;
}

struct Extent {
  float low, high;
};
Extent extent_of(std::span<const Entry> part, std::size_t axis) {
  Extent extent{part[0].at[axis], part[0].at[axis]};
  for (const Entry& e : part) {
    extent.low = std::min(extent.low, e.at[axis]);
    extent.high = std::max(extent.high, e.at[axis]);
  }
  return extent;
}

/// Swaps what belongs behind to the back. Returns how many stay in front, from `begin` on.
template <class Front>
std::size_t bring_to_front(std::span<Entry> part, std::size_t begin, Front&& is_in_front) {
  std::size_t left = begin, right = part.size() - 1;
  for (;;) {
    while (left <= right && is_in_front(part[left])) ++left;
    while (right > 0 && left <= right && !is_in_front(part[right])) --right;
    if (left > right || right == 0) return left;
    std::swap(part[left], part[right]);
    ++left;
    --right;
  }
}

/// Parts the points in the middle of the longest side of their box, at the nearest place that leaves none empty.
struct Split {
  std::size_t axis, below;
  float cut;
  Split(std::span<Entry> part, const Box& box) {
    float longest = 0;
    for (std::size_t a = 0; a < 3; ++a) longest = std::max(longest, box.high[a] - box.low[a]);
    axis = 0;
    Extent extent{};
    float widest = -1;
    for (std::size_t a = 0; a < 3; ++a) {
      if (!(box.high[a] - box.low[a] > (1 - 1e-5F) * longest)) continue;
      const Extent along = extent_of(part, a);
      if (along.high - along.low <= widest) continue;
      axis = a;
      extent = along;
      widest = along.high - along.low;
    }
    if (widest < 0) extent = extent_of(part, axis);  // all in one place
    cut = std::clamp((box.low[axis] + box.high[axis]) / 2, extent.low, extent.high);
    const std::size_t first = bring_to_front(part, 0, [&](const Entry& e) { return e.at[axis] < cut; });
    const std::size_t last = bring_to_front(part, first, [&](const Entry& e) { return e.at[axis] <= cut; });
    below = std::clamp(part.size() / 2, first, last);
  }
};

/// Nodes of the part appended; `box` holds the part, and becomes its tightest.
void part_points(std::span<Entry> part, std::uint32_t before, Box& box, std::vector<Node>& nodes) {
  const std::size_t own = nodes.size();
  nodes.emplace_back();
  if (part.size() <= kLeafSize) {
    nodes[own].first = before;
    nodes[own].count = static_cast<std::uint16_t>(part.size());
    box = box_of(part);
    return;
  }
  const Split split{part, box};
  Box low = box, high = box;
  low.high[split.axis] = split.cut;
  high.low[split.axis] = split.cut;
  const auto below = part.first(split.below), above = part.subspan(split.below);
  const std::uint32_t middle = before + static_cast<std::uint32_t>(split.below);
  if (part.size() > kLargePart) {
    std::vector<Node> others;
    tbb::parallel_invoke([&] { part_points(below, before, low, nodes); },
                         [&] { part_points(above, middle, high, others); });
    const auto shift = static_cast<std::uint32_t>(nodes.size());
    nodes[own].first = shift;
    for (Node n : others) {
      if (n.count == 0) n.first += shift;
      nodes.push_back(n);
    }
  } else {
    part_points(below, before, low, nodes);
    nodes[own].first = static_cast<std::uint32_t>(nodes.size());
    part_points(above, middle, high, nodes);
  }
  nodes[own].axis = static_cast<std::uint16_t>(split.axis);
  nodes[own].low = low.high[split.axis];
  nodes[own].high = high.low[split.axis];
  for (std::size_t a = 0; a < 3; ++a) {
    box.low[a] = std::min(low.low[a], high.low[a]);
    box.high[a] = std::max(low.high[a], high.high[a]);
  }
}

/// The k nearest so far, kept in order in the caller's own array.
class NearestSet {
 public:
  explicit NearestSet(std::span<Neighbour> found) : found_{found} {}
  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] float bound() const { return bound_; }
  void add(float squared_distance, std::uint32_t index) {
    std::size_t at = count_ == found_.size() ? count_ - 1 : count_++;
    for (; at > 0 && found_[at - 1].squared_distance > squared_distance; --at) found_[at] = found_[at - 1];
    found_[at] = {index, squared_distance};
    if (count_ == found_.size()) bound_ = found_[count_ - 1].squared_distance;
  }

 private:
  std::span<Neighbour> found_;
  std::size_t count_ = 0;
  float bound_ = std::numeric_limits<float>::max();
};

/// The nearest within a bound, which lets the search leave out all that lies farther from the start.
class NearestOne {
 public:
  explicit NearestOne(float bound) : bound_{bound} {}
  [[nodiscard]] float bound() const { return bound_; }
  void add(float squared_distance, std::uint32_t index) {
    bound_ = squared_distance;
    found_ = Neighbour{index, squared_distance};
  }
  [[nodiscard]] const std::optional<Neighbour>& found() const { return found_; }

 private:
  float bound_;
  std::optional<Neighbour> found_;
};

/// All within a bound.
class AllWithin {
 public:
  AllWithin(float bound, std::vector<Neighbour>& found) : bound_{bound}, found_{found} {}
  [[nodiscard]] float bound() const { return bound_; }
  void add(float squared_distance, std::uint32_t index) { found_.push_back({index, squared_distance}); }

 private:
  float bound_;
  std::vector<Neighbour>& found_;
};

}  // namespace

/// Points in the order of the leaves, coordinates apart, with room behind for a look at kLanes of them.
struct KdTree::Index {
  std::vector<Node> nodes;
  std::vector<float> x, y, z;
  std::vector<std::uint32_t> order;  ///< index of the point
  std::vector<std::uint32_t> place;  ///< of the point of an index
  Box box{};

  explicit Index(std::span<const Eigen::Vector3f> from) {
    const std::size_t count = from.size();
    if (count == 0) return;
    std::vector<Entry> entries(count);
    for (std::size_t i = 0; i < count; ++i)
      entries[i] = {{from[i].x(), from[i].y(), from[i].z()}, static_cast<std::uint32_t>(i)};
    box = box_of(entries);
    nodes.reserve(count / 4);
    // Waiting for a half, a thread must not take up work of whoever asked for the tree.
    tbb::this_task_arena::isolate([&] { part_points(entries, 0, box, nodes); });
    nodes.shrink_to_fit();
    x.resize(count + kLanes);
    y.resize(count + kLanes);
    z.resize(count + kLanes);
    order.resize(count);
    place.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const Entry& e = entries[i];
      x[i] = e.at[0];
      y[i] = e.at[1];
      z[i] = e.at[2];
      order[i] = e.index;
      place[e.index] = static_cast<std::uint32_t>(i);
    }
  }

  /// Shows the set every point nearer than its bound, which may fall on the way; equally near ones always in the same
  /// order.
  template <class Set>
  void search(const Eigen::Vector3f& query, Set& set) const {
    if (order.empty()) return;
    const Distances at{query.x(), query.y(), query.z()};
    Distances beyond{};  // squared, of the box the search is in
    float all = 0;
    for (std::size_t a = 0; a < 3; ++a) {
      const float out = at[a] < box.low[a] ? at[a] - box.low[a] : at[a] > box.high[a] ? at[a] - box.high[a] : 0;
      beyond[a] = out * out;
      all += beyond[a];
    }
    search_from(0, at, all, beyond, set);
  }

 private:
  template <class Set>
  void search_from(std::uint32_t number, const Distances& at, float nearest, Distances& beyond, Set& set) const {
    const Node& node = nodes[number];
    if (node.count > 0) return look_at(node, at, set);
    const float from_low = at[node.axis] - node.low, from_high = at[node.axis] - node.high;
    const bool is_low = from_low + from_high < 0;
    search_from(is_low ? number + 1 : node.first, at, nearest, beyond, set);
    const float out = is_low ? from_high : from_low;
    const float before = beyond[node.axis];
    nearest = nearest + out * out - before;
    if (!(nearest <= set.bound())) return;
    beyond[node.axis] = out * out;
    search_from(is_low ? node.first : number + 1, at, nearest, beyond, set);
    beyond[node.axis] = before;
  }

  template <class Set>
  void look_at(const Node& leaf, const Distances& at, Set& set) const {
    using Lanes = float __attribute__((vector_size(4 * kLanes)));
    const auto load = [](const float* from) {
      Lanes lanes;
      __builtin_memcpy(&lanes, from, sizeof lanes);
      return lanes;
    };
    for (std::uint32_t i = 0; i < leaf.count; i += kLanes) {
      const std::uint32_t first = leaf.first + i;
      const Lanes dx = load(&x[first]) - at[0], dy = load(&y[first]) - at[1], dz = load(&z[first]) - at[2];
      const Lanes squared = dx * dx + dy * dy + dz * dz;
      const std::uint32_t count = std::min<std::uint32_t>(kLanes, leaf.count - i);
      for (std::uint32_t l = 0; l < count; ++l)
        if (squared[l] < set.bound()) set.add(squared[l], order[first + l]);
    }
  }
};

KdTree::KdTree(std::span<const Eigen::Vector3f> points) : index_{std::make_unique<Index>(points)} {}
KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

std::size_t KdTree::size() const { return index_->order.size(); }

Eigen::Vector3f KdTree::point(std::uint32_t index) const {
  const std::uint32_t i = index_->place[index];
  return {index_->x[i], index_->y[i], index_->z[i]};
}

std::size_t KdTree::nearest(const Eigen::Vector3f& query, std::span<Neighbour> found) const {
  if (found.empty()) return 0;
  NearestSet set{found};
  index_->search(query, set);
  return set.size();
}

Neighbour KdTree::nearest(const Eigen::Vector3f& query) const {
  NearestOne set{std::numeric_limits<float>::max()};
  index_->search(query, set);
  return set.found().value_or(Neighbour{});
}

std::optional<Neighbour> KdTree::nearest_within(const Eigen::Vector3f& query, float reach) const {
  NearestOne set{std::nextafter(reach * reach, std::numeric_limits<float>::max())};
  index_->search(query, set);
  return set.found();
}

std::vector<Neighbour> KdTree::within(const Eigen::Vector3f& query, float radius) const {
  std::vector<Neighbour> found;
  AllWithin set{radius * radius, found};
  index_->search(query, set);
  std::sort(found.begin(), found.end(),
            [](const Neighbour& a, const Neighbour& b) { return a.squared_distance < b.squared_distance; });
  return found;
}

std::span<const std::uint32_t> KdTree::leaf_order() const { return index_->order; }

}  // namespace telefab::scan
