// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace telefab::scan {

/// A point found: its index and its squared distance (unit of the cloud, squared).
struct Neighbour {
  std::uint32_t index = 0;
  float squared_distance = 0;
};

/// Nearest neighbours among fixed points. Keeps its own copy, so the span may die. Move only.
/// Same points, same answers; equal distances come in the order of the tree, which depends on the points alone.
/// Threads: const methods may be called from several threads at once. Cost: build O(n log n), query O(k log n).
class KdTree {
 public:
  explicit KdTree(std::span<const Eigen::Vector3f> points);
  ~KdTree();
  KdTree(KdTree&&) noexcept;
  KdTree& operator=(KdTree&&) noexcept;

  [[nodiscard]] std::size_t size() const;
  /// The point of this index, below size().
  [[nodiscard]] Eigen::Vector3f point(std::uint32_t index) const;
  /// Fills `found` with the nearest points, nearest first (a point of the tree finds itself), and returns how many:
  /// the smaller of found.size() and size().
  std::size_t nearest(const Eigen::Vector3f& query, std::span<Neighbour> found) const;
  /// The nearest point. The tree must not be empty.
  [[nodiscard]] Neighbour nearest(const Eigen::Vector3f& query) const;
  /// The nearest point if it is not farther than `reach`. Cheaper than nearest() where many queries are far away.
  [[nodiscard]] std::optional<Neighbour> nearest_within(const Eigen::Vector3f& query, float reach) const;
  /// All points nearer than `radius`, nearest first.
  [[nodiscard]] std::vector<Neighbour> within(const Eigen::Vector3f& query, float radius) const;
  /// The points in the order of the tree's leaves: neighbours in it are neighbours in space.
  [[nodiscard]] std::span<const std::uint32_t> leaf_order() const;

 private:
  struct Index;
  std::unique_ptr<Index> index_;
};

}  // namespace telefab::scan
