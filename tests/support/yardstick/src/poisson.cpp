// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/poisson.hpp>

#include <pcl/PolygonMesh.h>
#include <pcl/conversions.h>
#include <pcl/point_types.h>
#include <pcl/surface/poisson.h>

namespace telefab::test {

Result<FaceSet> poisson_faces(const scan::PointCloud& cloud, int depth) {
  if (!cloud.has_normals()) return fail(ErrorCode::InvalidInput, "Poisson needs normals");
  const pcl::PointCloud<pcl::PointNormal>::Ptr samples{new pcl::PointCloud<pcl::PointNormal>};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto& p = cloud.points[i];
    const auto& n = cloud.normals[i];
    samples->push_back({p.x(), p.y(), p.z(), n.x(), n.y(), n.z()});
  }
  pcl::Poisson<pcl::PointNormal> poisson;
  poisson.setDepth(depth);
  poisson.setPointWeight(4);
  poisson.setInputCloud(samples);
  pcl::PolygonMesh made;
  poisson.reconstruct(made);
  pcl::PointCloud<pcl::PointXYZ> corners;
  pcl::fromPCLPointCloud2(made.cloud, corners);
  FaceSet found;
  for (const auto& p : corners) found.corners.emplace_back(cloud.origin + p.getVector3fMap().cast<double>());
  for (const auto& polygon : made.polygons) {
    const std::vector<std::uint32_t> v{polygon.vertices.begin(), polygon.vertices.end()};
    for (std::size_t k = 2; k < v.size(); ++k) found.faces.push_back({v[0], v[k - 1], v[k]});
  }
  if (found.faces.empty()) return fail(ErrorCode::Internal, "Poisson gave no faces");
  return found;
}

}  // namespace telefab::test
