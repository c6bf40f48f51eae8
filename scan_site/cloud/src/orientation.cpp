// SPDX-License-Identifier: GPL-3.0-or-later
#include "orientation.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <queue>
#include <tuple>
#include <unordered_map>

namespace telefab::scan {
namespace {

/// Union-find whose members also know whether they are turned against the root of their set.
class SignedSets {
 public:
  explicit SignedSets(std::size_t count) : parent_(count), turned_(count, 0), size_(count, 1) {
    std::iota(parent_.begin(), parent_.end(), 0U);
  }
  struct Member {
    std::uint32_t root;
    bool turned;  ///< against the root
  };
  Member find(std::uint32_t i) {
    std::uint32_t root = i;
    bool turned = false;
    for (; parent_[root] != root; root = parent_[root]) turned ^= turned_[root] != 0;
    bool rest = turned;
    while (parent_[i] != root && i != root) {  // compress: every member on the way hangs below the root
      const std::uint32_t next = parent_[i];
      const bool own = turned_[i] != 0;
      parent_[i] = root;
      turned_[i] = rest ? 1 : 0;
      rest ^= own;
      i = next;
    }
    return {root, turned};
  }
  /// Joins two roots; `opposed` says how the second's root stands to the first's. Returns the root that remains.
  std::uint32_t join(std::uint32_t a, std::uint32_t b, bool opposed) {
    if (size_[a] < size_[b]) std::swap(a, b);
    parent_[b] = a;
    turned_[b] = opposed ? 1 : 0;
    size_[a] += size_[b];
    return a;
  }
  /// As join, but the first stays the root, so that its side stays the side the set is measured by.
  void hang(std::uint32_t root, std::uint32_t below, bool opposed) {
    parent_[below] = root;
    turned_[below] = opposed ? 1 : 0;
    size_[root] += size_[below];
  }

 private:
  std::vector<std::uint32_t> parent_;
  std::vector<std::uint8_t> turned_;
  std::vector<std::uint32_t> size_;
};

struct Edge {
  std::uint32_t a, b;
  float vote;  ///< agreement times confidence
};

constexpr float kSureVote = 0.9F;
constexpr float kOutsideWeight = 0.5F;       ///< one look outside against one vote of a sure neighbour pair
constexpr double kEnoughOutside = 0.1;       ///< share of a piece's points that must see it before it counts
constexpr std::size_t kNestingSamples = 24;  ///< points of a piece at which the winding of the others is taken

std::vector<Edge> edges_of(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  const std::size_t n = graph.size();
  std::vector<std::uint32_t> first(n + 1, 0);
  const auto is_listed = [&](std::uint32_t a, std::uint32_t b) {  // b among a's neighbours
    const auto near = graph.neighbours_of(a);
    return std::find(near.begin(), near.end(), b) != near.end();
  };
  const auto owns = [&](std::uint32_t a, std::uint32_t b) { return a < b || !is_listed(b, a); };
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, n, 4096}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i)
      for (const std::uint32_t j : graph.neighbours_of(i))
        first[i + 1] += owns(static_cast<std::uint32_t>(i), j) ? 1 : 0;
  });
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<Edge> edges(first[n]);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, n, 4096}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      std::size_t at = first[i];
      for (const std::uint32_t j : graph.neighbours_of(i)) {
        if (!owns(static_cast<std::uint32_t>(i), j)) continue;
        const PairVote vote = pair_vote(points[i], graph.normal[i], points[j], graph.normal[j]);
        edges[at++] = {static_cast<std::uint32_t>(i), j, vote.agreement * vote.confidence};
      }
    }
  });
  return edges;
}

/// Joins clusters along the strongest sum of votes, again and again; the sums of joined clusters are added.
class ClusterMerge {
 public:
  ClusterMerge(std::size_t clusters) : links_(clusters), sets_(clusters) {}

  void vote(std::uint32_t a, std::uint32_t b, double value) {
    if (a == b || value == 0) return;
    links_[a][b] += value;
    links_[b][a] += value;
  }
  void run(const std::stop_token& stop) {
    std::priority_queue<Link> queue;
    for (std::uint32_t a = 0; a < links_.size(); ++a)
      for (const auto& [b, value] : links_[a])
        if (a < b) queue.push(make(a, b, value));
    while (!queue.empty() && !stop.stop_requested()) {
      const Link link = queue.top();
      queue.pop();
      const auto found = links_[link.a].find(link.b);
      if (found == links_[link.a].end() || found->second != link.value) continue;  // an older sum
      merge(link, queue);
    }
  }
  [[nodiscard]] SignedSets& sets() { return sets_; }

 private:
  struct Link {
    double strength;
    std::uint32_t a, b;
    double value;
    friend bool operator<(const Link& l, const Link& r) {
      return std::tie(l.strength, r.a, r.b) < std::tie(r.strength, l.a, l.b);  // strongest first, then lowest index
    }
  };
  static Link make(std::uint32_t a, std::uint32_t b, double value) {
    return {std::abs(value), std::min(a, b), std::max(a, b), value};
  }
  void merge(const Link& link, std::priority_queue<Link>& queue) {
    const bool opposed = link.value < 0;
    const std::uint32_t kept = links_[link.a].size() >= links_[link.b].size() ? link.a : link.b;
    const std::uint32_t gone = kept == link.a ? link.b : link.a;
    sets_.hang(kept, gone, opposed);
    for (const auto& [other, value] : links_[gone]) {
      links_[other].erase(gone);
      if (other == kept) continue;
      double& sum = links_[kept][other];
      sum += opposed ? -value : value;
      links_[other][kept] = sum;
      queue.push(make(kept, other, sum));
    }
    links_[gone].clear();
  }

  std::vector<std::unordered_map<std::uint32_t, double>> links_;
  SignedSets sets_;
};

}  // namespace

PairVote pair_vote(const Eigen::Vector3f& point_a, const Eigen::Vector3f& normal_a, const Eigen::Vector3f& point_b,
                   const Eigen::Vector3f& normal_b) {
  Eigen::Vector3f along = point_b - point_a;
  const float length = along.norm();
  if (!(length > 0)) return {normal_a.dot(normal_b), 0.5F};
  along /= length;
  const float out_a = along.dot(normal_a), out_b = along.dot(normal_b);
  const Eigen::Vector3f carried = normal_a - 2 * out_a * along;
  return {carried.dot(normal_b), 1 - 0.5F * (std::abs(out_a) + std::abs(out_b))};
}

namespace {

/// Sets of points joined by sure votes, numbered 0.. in the order of their first point.
struct Patches {
  std::vector<std::uint32_t> of;  ///< one a point
  std::vector<bool> turned;       ///< one a point: against its patch
  std::size_t count = 0;
};

Patches sure_patches(std::vector<Edge>& edges, std::size_t points) {
  const auto unsure =
      std::partition(edges.begin(), edges.end(), [](const Edge& e) { return std::abs(e.vote) >= kSureVote; });
  tbb::parallel_sort(edges.begin(), unsure, [](const Edge& l, const Edge& r) {
    const float vl = std::abs(l.vote), vr = std::abs(r.vote);
    return std::tie(vr, l.a, l.b) < std::tie(vl, r.a, r.b);
  });
  SignedSets sets{points};
  for (auto e = edges.begin(); e != unsure; ++e) {
    const auto a = sets.find(e->a), b = sets.find(e->b);
    if (a.root != b.root) sets.join(a.root, b.root, a.turned ^ b.turned ^ (e->vote < 0));
  }
  Patches patches;
  patches.of.resize(points);
  patches.turned.resize(points);
  std::vector<std::uint32_t> number(points, UINT32_MAX);
  for (std::uint32_t i = 0; i < points; ++i) {
    const auto member = sets.find(i);
    if (number[member.root] == UINT32_MAX) number[member.root] = static_cast<std::uint32_t>(patches.count++);
    patches.of[i] = number[member.root];
    patches.turned[i] = member.turned;
  }
  return patches;
}

/// What one piece says about its own side when the outside does not.
struct PieceMembers {
  std::vector<std::uint32_t> points;
  std::size_t outside_known = 0;
};

double signed_area(const SurfaceGraph& graph, const std::vector<bool>& turned, std::uint32_t i) {
  return turned[i] ? -graph.area[i] : graph.area[i];
}

/// Positive if the piece's normals point outward on the whole: the volume they enclose, or, where the piece is far
/// from closed, the side away from the middle of the cloud.
double outwardness(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph, const std::vector<bool>& turned,
                   const PieceMembers& piece, const Eigen::Vector3d& middle_of_cloud) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero(), total = Eigen::Vector3d::Zero();
  double area = 0;
  for (const std::uint32_t i : piece.points) {
    middle += points[i].cast<double>();
    total += signed_area(graph, turned, i) * graph.normal[i].cast<double>();
    area += graph.area[i];
  }
  middle /= static_cast<double>(piece.points.size());
  const bool is_closed = total.norm() < 0.15 * area;  // the normals of a closed surface add up to nothing
  const Eigen::Vector3d& about = is_closed ? middle : middle_of_cloud;
  double sum = 0;
  for (const std::uint32_t i : piece.points)
    sum += signed_area(graph, turned, i) * (points[i].cast<double>() - about).dot(graph.normal[i].cast<double>());
  return sum;
}

/// True if the piece lies within the solid that the points already oriented enclose.
bool lies_in_solid(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph, const std::vector<bool>& turned,
                   const PieceMembers& piece, std::span<const std::uint32_t> oriented) {
  const std::size_t step = std::max<std::size_t>(1, piece.points.size() / kNestingSamples);
  std::vector<double> windings;
  for (std::size_t s = 0; s < piece.points.size(); s += step) {
    const Eigen::Vector3d at = points[piece.points[s]].cast<double>();
    double winding = 0;
    for (const std::uint32_t i : oriented) {
      const Eigen::Vector3d d = points[i].cast<double>() - at;
      const double square = d.squaredNorm();
      if (square > 0)
        winding += signed_area(graph, turned, i) * d.dot(graph.normal[i].cast<double>()) / (square * std::sqrt(square));
    }
    windings.push_back(winding / (4 * std::numbers::pi));
  }
  std::nth_element(windings.begin(), windings.begin() + static_cast<std::ptrdiff_t>(windings.size() / 2),
                   windings.end());
  return windings[windings.size() / 2] > 0.8;  // clearly: an open scan winds by less
}

}  // namespace

std::vector<std::uint32_t> pieces_of(const SurfaceGraph& graph, std::size_t& count) {
  SignedSets sets{graph.size()};
  for (std::uint32_t i = 0; i < graph.size(); ++i)
    for (const std::uint32_t j : graph.neighbours_of(i)) {
      const std::uint32_t a = sets.find(i).root, b = sets.find(j).root;
      if (a != b) sets.join(a, b, false);
    }
  std::vector<std::uint32_t> piece(graph.size()), number(graph.size(), UINT32_MAX);
  count = 0;
  for (std::uint32_t i = 0; i < graph.size(); ++i) {
    const std::uint32_t root = sets.find(i).root;
    if (number[root] == UINT32_MAX) number[root] = static_cast<std::uint32_t>(count++);
    piece[i] = number[root];
  }
  return piece;
}

Result<Orientation> choose_sides(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph,
                                 std::span<const std::int8_t> outward_side, const std::stop_token& stop) {
  const std::size_t n = graph.size();
  std::vector<Edge> edges = edges_of(points, graph);
  if (stop.stop_requested()) return cancelled("orienting normals");
  const Patches patches = sure_patches(edges, n);
  Orientation result;
  result.piece = pieces_of(graph, result.pieces);
  std::vector<PieceMembers> pieces(result.pieces);
  for (std::uint32_t i = 0; i < n; ++i) {
    pieces[result.piece[i]].points.push_back(i);
    pieces[result.piece[i]].outside_known += outward_side[i] != 0 ? 1 : 0;
  }
  const auto outside_counts = [&](const PieceMembers& p) {
    return static_cast<double>(p.outside_known) >= kEnoughOutside * static_cast<double>(p.points.size());
  };
  for (const PieceMembers& p : pieces) result.outside_decides.push_back(outside_counts(p));
  if (stop.stop_requested()) return cancelled("orienting normals");

  // Votes between patches, and between patches and the outside, which is one more cluster.
  const auto outside = static_cast<std::uint32_t>(patches.count);
  std::vector<Edge> votes;
  for (const Edge& e : edges)
    if (patches.of[e.a] != patches.of[e.b])
      votes.push_back(
          {patches.of[e.a], patches.of[e.b], patches.turned[e.a] != patches.turned[e.b] ? -e.vote : e.vote});
  for (std::uint32_t i = 0; i < n; ++i)
    if (outward_side[i] != 0 && outside_counts(pieces[result.piece[i]]))
      votes.push_back({patches.of[i], outside,
                       kOutsideWeight * static_cast<float>(patches.turned[i] ? -outward_side[i] : outward_side[i])});
  ClusterMerge clusters{patches.count + 1};
  for (const Edge& v : votes) clusters.vote(v.a, v.b, v.vote);
  clusters.run(stop);
  if (stop.stop_requested()) return cancelled("orienting normals");

  SignedSets& sets = clusters.sets();
  const auto out = sets.find(outside);
  result.turned.resize(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    const auto member = sets.find(patches.of[i]);
    result.turned[i] = member.turned ^ patches.turned[i] ^ (member.root == out.root && out.turned);
  }

  // How well is each patch held where it is? A weak or contradicted hold is reported.
  std::vector<double> support(patches.count + 1, 0), strength(patches.count + 1, 0);
  for (const Edge& v : votes) {
    const double held = sets.find(v.a).turned != sets.find(v.b).turned ? -v.vote : v.vote;
    for (const std::uint32_t end : {v.a, v.b}) {
      support[end] += held;
      strength[end] += std::abs(v.vote);
    }
  }
  for (std::uint32_t i = 0; i < n; ++i)
    if (strength[patches.of[i]] > 0 && support[patches.of[i]] < 0.2 * strength[patches.of[i]])
      ++result.uncertain_points;

  // Pieces that the outside does not decide: their volume is positive, or negative where they bound a void.
  Eigen::Vector3d middle_of_cloud = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3f& p : points) middle_of_cloud += p.cast<double>();
  middle_of_cloud /= static_cast<double>(n);
  std::vector<std::uint32_t> order(result.pieces), oriented;
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t l, std::uint32_t r) { return pieces[l].points.size() > pieces[r].points.size(); });
  for (const std::uint32_t p : order)
    if (outside_counts(pieces[p])) oriented.insert(oriented.end(), pieces[p].points.begin(), pieces[p].points.end());
  for (const std::uint32_t p : order) {
    if (outside_counts(pieces[p])) continue;
    const bool is_void = lies_in_solid(points, graph, result.turned, pieces[p], oriented);
    if ((outwardness(points, graph, result.turned, pieces[p], middle_of_cloud) < 0) != is_void)
      for (const std::uint32_t i : pieces[p].points) result.turned[i] = !result.turned[i];
    oriented.insert(oriented.end(), pieces[p].points.begin(), pieces[p].points.end());
    if (stop.stop_requested()) return cancelled("orienting normals");
  }
  return result;
}

}  // namespace telefab::scan
