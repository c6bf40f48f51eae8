// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/poisson.hpp>

#include <pcl/PolygonMesh.h>
#include <pcl/conversions.h>
#include <pcl/point_types.h>
#include <pcl/surface/poisson.h>

namespace telefab::test {

Result<MeshTruth> poisson_mesh(const scan::PointCloud& cloud) {
  if (!cloud.has_normals()) return fail(ErrorCode::InvalidInput, "Poisson needs normals");
  const pcl::PointCloud<pcl::PointNormal>::Ptr samples{new pcl::PointCloud<pcl::PointNormal>};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto& p = cloud.points[i];
    const auto& n = cloud.normals[i];
    samples->push_back({p.x(), p.y(), p.z(), n.x(), n.y(), n.z()});
  }
  pcl::Poisson<pcl::PointNormal> poisson;
  poisson.setDepth(8);
  poisson.setPointWeight(4);
  poisson.setInputCloud(samples);
  pcl::PolygonMesh made;
  poisson.reconstruct(made);
  pcl::PointCloud<pcl::PointXYZ> corners;
  pcl::fromPCLPointCloud2(made.cloud, corners);
  std::vector<Vec3> places;
  for (const auto& p : corners) places.emplace_back(cloud.origin + p.getVector3fMap().cast<double>());
  std::vector<std::array<std::uint32_t, 3>> faces;
  for (const auto& polygon : made.polygons) {
    const std::vector<std::uint32_t> v{polygon.vertices.begin(), polygon.vertices.end()};
    for (std::size_t k = 2; k < v.size(); ++k) faces.push_back({v[0], v[k - 1], v[k]});
  }
  if (faces.empty()) return fail(ErrorCode::Internal, "Poisson gave no faces");
  return MeshTruth{places, faces};
}

}  // namespace telefab::test
