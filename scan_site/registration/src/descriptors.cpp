// SPDX-License-Identifier: GPL-3.0-or-later
#include "descriptors.hpp"

#include <pcl/features/fpfh.h>
#include <pcl/point_types.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <vector>

// PCL does the arithmetic of the histograms; neighbours come from the tree there is, and the threads are oneTBB's as
// everywhere. PCL is built for plain x86-64, so this file must be too: Eigen's matrices cross the border.
namespace telefab::scan {

Descriptors describe_points(std::span<const Eigen::Vector3f> points, std::span<const Eigen::Vector3f> normals,
                            const KdTree& tree, float radius) {
  const std::size_t count = points.size();
  pcl::PointCloud<pcl::PointXYZ> places;
  pcl::PointCloud<pcl::Normal> directions;
  places.reserve(count);
  directions.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    places.push_back({points[i].x(), points[i].y(), points[i].z()});
    directions.push_back({normals[i].x(), normals[i].y(), normals[i].z()});
  }
  std::vector<pcl::Indices> near(count);
  std::vector<std::vector<float>> squared(count);
  constexpr Eigen::Index kBins = kDescriptorLength / 3;
  const auto rows = static_cast<Eigen::Index>(count);
  Eigen::MatrixXf alpha = Eigen::MatrixXf::Zero(rows, kBins), phi = alpha, theta = alpha;
  pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> histograms;
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, count, 64}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      for (const Neighbour& n : tree.within(points[i], radius)) {
        near[i].push_back(static_cast<pcl::index_t>(n.index));
        squared[i].push_back(n.squared_distance);
      }
      if (near[i].size() > 1)
        histograms.computePointSPFHSignature(places, directions, static_cast<pcl::index_t>(i), static_cast<int>(i),
                                             near[i], alpha, phi, theta);
    }
  });
  Descriptors result = Descriptors::Zero(kDescriptorLength, rows);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, count, 64}, [&](const auto& range) {
    Eigen::VectorXf column;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      if (near[i].size() < 2) continue;
      histograms.weightPointSPFHSignature(alpha, phi, theta, near[i], squared[i], column);
      if (column.allFinite()) result.col(static_cast<Eigen::Index>(i)) = column;
    }
  });
  return result;
}

}  // namespace telefab::scan
