// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/completion/winding_tree.hpp>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>

#include "tree_sums.hpp"

namespace telefab::scan {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr std::uint32_t kLeaf = 16;
/// Smaller ranges are built by one thread.
constexpr std::uint32_t kSerial = 8192;
/// Places that share one list.
constexpr std::size_t kBlock = 64;
/// A wider block, in mean spacings, would find few nodes that answer for all of it.
constexpr float kBlockWidth = 12;

/// Nodes of a tree over `count` samples.
std::uint32_t nodes_of(std::uint32_t count) {
  return count <= kLeaf ? 1 : 1 + nodes_of(count / 2) + nodes_of(count - count / 2);
}

}  // namespace

struct WindingTree::Tree {
  struct Node {
    std::uint32_t next;   ///< in order, after all below this one
    std::uint32_t first;  ///< samples
    std::uint32_t last;
    float radius;  ///< about the centroid
  };

  double unit = 1;  ///< lengths are divided by this: weights of the sixth power stay within the range of a float
  Vector3d origin = Vector3d::Zero();
  std::vector<Node> nodes;           ///< a parent before its children, the first child next to it
  std::vector<TreeMoments> moments;  ///< one a node
  std::vector<TreeSample> samples;   ///< in the order of the leaves, relative to the origin
  TreeSumSet sums = fastest_tree_sums();
  Vector3d normal_sum = Vector3d::Zero();
  double area_sum = 0;

  void build(std::uint32_t node, std::uint32_t first, std::uint32_t last);
  void measure_leaf(std::uint32_t node);
  void join_children(std::uint32_t node, std::uint32_t left, std::uint32_t right);
};

namespace {

/// Working space of one block: who answers for whom.
struct Lists {
  std::vector<TreeSample> samples;
  std::vector<const TreeMoments*> nodes;
};

/// Moments about `centre` in double while a node is put together.
struct Moments {
  double area = 0;
  Vector3d place = Vector3d::Zero();
  Vector3d normal = Vector3d::Zero();
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  double soft = 0;
  double scatter = 0;

  void add(const Vector3d& n, const Vector3d& offset) { spread += n * offset.transpose(); }
  [[nodiscard]] TreeMoments packed() const {
    const auto f = [](double v) { return static_cast<float>(v); };
    return {f(place.x()),
            f(place.y()),
            f(place.z()),
            f(area),
            f(normal.x()),
            f(normal.y()),
            f(normal.z()),
            f(spread(0, 0)),
            f((spread(0, 1) + spread(1, 0)) / 2),
            f((spread(0, 2) + spread(2, 0)) / 2),
            f(spread(1, 1)),
            f((spread(1, 2) + spread(2, 1)) / 2),
            f(spread(2, 2)),
            f(soft),
            f(scatter)};
  }
};

Vector3d place_of(const TreeSample& s) { return {s.x, s.y, s.z}; }
Vector3d normal_of(const TreeSample& s) { return {s.nx, s.ny, s.nz}; }
Vector3d place_of(const TreeMoments& m) { return {m.x, m.y, m.z}; }
Vector3d normal_of(const TreeMoments& m) { return {m.nx, m.ny, m.nz}; }
Eigen::Matrix3d spread_of(const TreeMoments& m) {
  Eigen::Matrix3d s;
  s << m.xx, m.xy, m.xz, m.xy, m.yy, m.yz, m.xz, m.yz, m.zz;
  return s;
}

}  // namespace

void WindingTree::Tree::measure_leaf(std::uint32_t node) {
  const Node& range = nodes[node];
  Moments m;
  for (std::uint32_t i = range.first; i < range.last; ++i) {
    m.area += samples[i].area;
    m.place += samples[i].area * place_of(samples[i]);
    m.normal += normal_of(samples[i]);
  }
  const double count = range.last - range.first;
  if (m.area > 0) {
    m.place /= m.area;
  } else {
    for (std::uint32_t i = range.first; i < range.last; ++i) m.place += place_of(samples[i]) / count;
  }
  m.soft = m.area / count;
  moments[node] = m.packed();
  const Vector3d centre = place_of(moments[node]);
  double radius2 = 0;
  for (std::uint32_t i = range.first; i < range.last; ++i) {
    m.add(normal_of(samples[i]), place_of(samples[i]) - centre);
    const double away2 = (place_of(samples[i]) - centre).squaredNorm();
    radius2 = std::max(radius2, away2);
    if (m.area > 0) m.scatter += samples[i].area * away2 / m.area;
  }
  moments[node] = m.packed();
  nodes[node].radius = static_cast<float>(std::sqrt(radius2));
}

void WindingTree::Tree::join_children(std::uint32_t node, std::uint32_t left, std::uint32_t right) {
  const TreeMoments& a = moments[left];
  const TreeMoments& b = moments[right];
  Moments m;
  m.area = static_cast<double>(a.area) + b.area;
  m.place = m.area > 0 ? Vector3d{(a.area * place_of(a) + b.area * place_of(b)) / m.area}
                       : Vector3d{(place_of(a) + place_of(b)) / 2};
  m.normal = normal_of(a) + normal_of(b);
  m.soft = m.area / (nodes[node].last - nodes[node].first);
  moments[node] = m.packed();
  const Vector3d centre = place_of(moments[node]);
  m.spread = spread_of(a) + spread_of(b);
  m.add(normal_of(a), place_of(a) - centre);
  m.add(normal_of(b), place_of(b) - centre);
  for (const TreeMoments* part : {&a, &b})
    if (m.area > 0) m.scatter += part->area * (part->scatter + (place_of(*part) - centre).squaredNorm()) / m.area;
  moments[node] = m.packed();
  double radius2 = 0;
  for (std::uint32_t i = nodes[node].first; i < nodes[node].last; ++i)
    radius2 = std::max(radius2, (place_of(samples[i]) - centre).squaredNorm());
  nodes[node].radius = static_cast<float>(std::sqrt(radius2));
}

void WindingTree::Tree::build(std::uint32_t node, std::uint32_t first, std::uint32_t last) {
  const std::uint32_t count = last - first;
  nodes[node] = {node + nodes_of(count), first, last, 0};
  if (count <= kLeaf) {
    measure_leaf(node);
    return;
  }
  Vector3f low = Vector3f::Constant(1e30F), high = -low;
  for (std::uint32_t i = first; i < last; ++i) {
    const Vector3f p{samples[i].x, samples[i].y, samples[i].z};
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  int axis = 0;
  (high - low).maxCoeff(&axis);
  const std::uint32_t middle = first + count / 2;
  // Which of equal samples goes where must not depend on the order they came in.
  const auto rank = [](const TreeSample& s) { return std::array{s.x, s.y, s.z, s.nx, s.ny, s.nz, s.area}; };
  constexpr std::array kAlong{&TreeSample::x, &TreeSample::y, &TreeSample::z};
  const auto along = kAlong[static_cast<std::size_t>(axis)];
  std::nth_element(samples.begin() + first, samples.begin() + middle, samples.begin() + last,
                   [&](const TreeSample& a, const TreeSample& b) {
                     return a.*along != b.*along ? a.*along < b.*along : rank(a) < rank(b);
                   });
  const std::uint32_t left = node + 1;
  const std::uint32_t right = left + nodes_of(count / 2);
  if (count > kSerial) {
    tbb::parallel_invoke([&] { build(left, first, middle); }, [&] { build(right, middle, last); });
  } else {
    build(left, first, middle);
    build(right, middle, last);
  }
  join_children(node, left, right);
}

namespace {

template <class Tree>
void gather(const Tree& tree, const Vector3f& centre, float reach, float opening, Lists& lists) {
  lists.samples.clear();
  lists.nodes.clear();
  for (std::uint32_t i = 0; i < tree.nodes.size();) {
    const auto& node = tree.nodes[i];
    const TreeMoments& m = tree.moments[i];
    const float x = m.x - centre.x(), y = m.y - centre.y(), z = m.z - centre.z();
    const float far = opening * node.radius + reach;
    if (x * x + y * y + z * z > far * far) {
      lists.nodes.push_back(&m);
      i = node.next;
    } else if (node.next == i + 1) {
      for (std::uint32_t k = node.first; k < node.last; ++k) {
        TreeSample s = tree.samples[k];
        s.x -= centre.x();
        s.y -= centre.y();
        s.z -= centre.z();
        lists.samples.push_back(s);
      }
      i = node.next;
    } else {
      ++i;
    }
  }
}

WideField field_of(const TreeSums& s, std::size_t lane, float unit) {
  WideField field;
  field.winding = s.winding[lane] / (4 * std::numbers::pi_v<float>);
  const float weight = s.weight[lane];
  if (!(weight > 0)) return field;
  const float length = std::sqrt(s.nx[lane] * s.nx[lane] + s.ny[lane] * s.ny[lane] + s.nz[lane] * s.nz[lane]);
  field.agreement = length / weight;
  float along = s.plane[lane];
  // The mean offset against the mean normal: its own half of the unbiased distance.
  if (length > 1e-6F * weight)
    along = (along - (s.px[lane] * s.nx[lane] + s.py[lane] * s.ny[lane] + s.pz[lane] * s.nz[lane]) / length) / 2;
  field.value = unit * along / weight;
  return field;
}

/// Calls take(index, sums, lane) for every place of a block.
template <class Tree, class Take>
void ask_block(const Tree& tree, std::span<const Vector3f> places, float opening, bool wide, Lists& lists,
               Take&& take) {
  const auto local = [&](const Vector3f& p) {
    return Vector3f{((p.template cast<double>() - tree.origin) / tree.unit).template cast<float>()};
  };
  Vector3f low = local(places[0]), high = low;
  for (const Vector3f& p : places) {
    low = low.cwiseMin(local(p));
    high = high.cwiseMax(local(p));
  }
  const Vector3f centre = (low + high) / 2;
  gather(tree, centre, (high - low).norm() / 2, opening, lists);
  const TreeList list{lists.samples.data(), lists.samples.size(), lists.nodes.data(), lists.nodes.size()};
  for (std::size_t i = 0; i < places.size(); i += kTreeLanes) {
    const std::size_t count = std::min(kTreeLanes, places.size() - i);
    TreePlaces at{{centre.x(), centre.y(), centre.z()}, {}, {}, {}};
    for (std::size_t l = 0; l < kTreeLanes; ++l) {
      const Vector3f q = local(places[i + std::min(l, count - 1)]) - centre;
      at.x[l] = q.x();
      at.y[l] = q.y();
      at.z[l] = q.z();
    }
    TreeSums sums{};
    (wide ? tree.sums.wide : tree.sums.winding)(list, at, sums);
    for (std::size_t l = 0; l < count; ++l) take(i + l, sums, l);
  }
}

/// Where blocks begin, and the end: at most kBlock places each, none wider than kBlockWidth.
std::vector<std::size_t> blocks_of(std::span<const Vector3f> places, float unit) {
  std::vector<std::size_t> begins;
  Vector3f low = Vector3f::Zero(), high = low;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Vector3f wider_low = low.cwiseMin(places[i]), wider_high = high.cwiseMax(places[i]);
    if (begins.empty() || i - begins.back() == kBlock || (wider_high - wider_low).norm() > kBlockWidth * unit) {
      begins.push_back(i);
      low = high = places[i];
    } else {
      low = wider_low;
      high = wider_high;
    }
  }
  begins.push_back(places.size());
  return begins;
}

template <class Tree, class Take>
void ask_blocks(const Tree& tree, std::span<const Vector3f> places, float opening, bool wide, Take&& take) {
  const std::vector<std::size_t> begins = blocks_of(places, static_cast<float>(tree.unit));
  // A caller that is itself one of many tasks must not begin another of them in the midst of its own.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, begins.size() - 1, 4}, [&](const auto& range) {
      thread_local Lists lists;
      for (std::size_t b = range.begin(); b < range.end(); ++b) {
        const auto block = places.subspan(begins[b], begins[b + 1] - begins[b]);
        ask_block(tree, block, opening, wide, lists,
                  [&](std::size_t i, const TreeSums& sums, std::size_t lane) { take(begins[b] + i, sums, lane); });
      }
    });
  });
}

}  // namespace

WindingTree::WindingTree(std::span<const Vector3f> points, std::span<const Vector3f> normals,
                         std::span<const float> areas) {
  auto tree = std::make_unique<Tree>();
  const std::size_t count = std::min({points.size(), normals.size(), areas.size()});
  for (std::size_t i = 0; i < count; ++i) {
    tree->area_sum += areas[i];
    tree->normal_sum += static_cast<double>(areas[i]) * normals[i].cast<double>();
    tree->origin += points[i].cast<double>() / static_cast<double>(count);
  }
  if (tree->area_sum > 0) tree->unit = std::sqrt(tree->area_sum / static_cast<double>(count));
  const double area_unit = tree->unit * tree->unit;
  tree->samples.resize(count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, count, 4096}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const Vector3f p = ((points[i].cast<double>() - tree->origin) / tree->unit).cast<float>();
      const auto area = static_cast<float>(areas[i] / area_unit);
      const Vector3f n = area * normals[i];
      tree->samples[i] = {p.x(), p.y(), p.z(), area, n.x(), n.y(), n.z()};
    }
  });
  if (count > 0) {
    const std::uint32_t nodes = nodes_of(static_cast<std::uint32_t>(count));
    tree->nodes.resize(nodes);
    tree->moments.resize(nodes);
    tree->build(0, 0, static_cast<std::uint32_t>(count));
  }
  tree_ = std::move(tree);
}

WindingTree::~WindingTree() = default;
WindingTree::WindingTree(WindingTree&&) noexcept = default;
WindingTree& WindingTree::operator=(WindingTree&&) noexcept = default;

std::size_t WindingTree::size() const { return tree_->samples.size(); }

float WindingTree::winding(const Vector3f& place, float opening) const {
  thread_local Lists lists;
  float found = 0;
  ask_block(*tree_, {&place, 1}, opening, false, lists, [&](std::size_t, const TreeSums& sums, std::size_t lane) {
    found = sums.winding[lane] / (4 * std::numbers::pi_v<float>);
  });
  return found;
}

WideField WindingTree::wide(const Vector3f& place, float opening) const {
  thread_local Lists lists;
  WideField found;
  ask_block(*tree_, {&place, 1}, opening, true, lists, [&](std::size_t, const TreeSums& sums, std::size_t lane) {
    found = field_of(sums, lane, static_cast<float>(tree_->unit));
  });
  return found;
}

std::vector<float> WindingTree::windings(std::span<const Vector3f> places, float opening) const {
  std::vector<float> found(places.size());
  ask_blocks(*tree_, places, opening, false, [&](std::size_t i, const TreeSums& sums, std::size_t lane) {
    found[i] = sums.winding[lane] / (4 * std::numbers::pi_v<float>);
  });
  return found;
}

std::vector<WideField> WindingTree::wides(std::span<const Vector3f> places, float opening) const {
  std::vector<WideField> found(places.size());
  ask_blocks(*tree_, places, opening, true, [&](std::size_t i, const TreeSums& sums, std::size_t lane) {
    found[i] = field_of(sums, lane, static_cast<float>(tree_->unit));
  });
  return found;
}

Eigen::Vector3d WindingTree::mean_normal() const {
  return tree_->area_sum > 0 ? Eigen::Vector3d{tree_->normal_sum / tree_->area_sum} : Eigen::Vector3d::Zero();
}

}  // namespace telefab::scan
