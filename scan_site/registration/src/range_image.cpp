// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/range_image.hpp>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::scan {
namespace {

constexpr float kDepthEdge = 4;  ///< in spacings: a longer step between neighbouring cells is an edge, not a surface
constexpr double kMaxResidualPx = 1.5;
constexpr std::size_t kLeastPoints = 100;

struct Grid {
  const RangeView& view;
  std::span<const Eigen::Vector3f> points;
  [[nodiscard]] std::int32_t at(std::int64_t row, std::int64_t column) const {
    if (row < 0 || column < 0 || row >= view.rows || column >= view.columns) return RangeView::kEmpty;
    return view.at(static_cast<std::uint32_t>(row), static_cast<std::uint32_t>(column));
  }
};

float median_step(const Grid& grid) {
  std::vector<float> steps;
  for (std::uint32_t r = 0; r < grid.view.rows; ++r)
    for (std::uint32_t c = 0; c + 1 < grid.view.columns; ++c) {
      const std::int32_t a = grid.at(r, c), b = grid.at(r, c + 1);
      if (a >= 0 && b >= 0)
        steps.push_back((grid.points[static_cast<std::size_t>(a)] - grid.points[static_cast<std::size_t>(b)]).norm());
    }
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

/// Sum of the cross products of the four quadrants about a cell; zero where no quadrant is whole.
Eigen::Vector3f raw_normal(const Grid& grid, std::uint32_t row, std::uint32_t column, float longest) {
  const Eigen::Vector3f& p = grid.points[static_cast<std::size_t>(grid.at(row, column))];
  const std::int64_t r = row, c = column;
  const std::array<std::int32_t, 4> around{grid.at(r, c + 1), grid.at(r + 1, c), grid.at(r, c - 1), grid.at(r - 1, c)};
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (std::size_t q = 0; q < 4; ++q) {
    const std::int32_t a = around[q], b = around[(q + 1) % 4];
    if (a < 0 || b < 0) continue;
    const Eigen::Vector3f u = grid.points[static_cast<std::size_t>(a)] - p,
                          v = grid.points[static_cast<std::size_t>(b)] - p;
    if (u.norm() < longest && v.norm() < longest) sum += u.cross(v);
  }
  return sum;
}

std::optional<ParallelProjection> fit_projection(const Grid& grid) {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Matrix<double, 4, 2> right = Eigen::Matrix<double, 4, 2>::Zero();
  Vec3 middle = Vec3::Zero();
  for (const Eigen::Vector3f& p : grid.points) middle += p.cast<double>() / static_cast<double>(grid.points.size());
  const auto visit = [&](auto use) {
    for (std::uint32_t r = 0; r < grid.view.rows; ++r)
      for (std::uint32_t c = 0; c < grid.view.columns; ++c)
        if (const std::int32_t i = grid.at(r, c); i >= 0) {
          const Vec3 d = grid.points[static_cast<std::size_t>(i)].cast<double>() - middle;
          use(Eigen::Vector4d{d.x(), d.y(), d.z(), 1}, Eigen::RowVector2d{r, c});
        }
  };
  std::size_t count = 0;
  visit([&](const Eigen::Vector4d& p, const Eigen::RowVector2d& cell) {
    normal += p * p.transpose();
    right += p * cell;
    ++count;
  });
  const Eigen::Matrix<double, 4, 2> fit = normal.ldlt().solve(right);
  if (!fit.allFinite() || count < 100) return std::nullopt;
  double square = 0;
  visit([&](const Eigen::Vector4d& p, const Eigen::RowVector2d& cell) {
    square += (p.transpose() * fit - cell).squaredNorm();
  });
  ParallelProjection projection;
  projection.residual_px = std::sqrt(square / static_cast<double>(count));
  projection.row = fit.col(0);
  projection.column = fit.col(1);
  const Vec3 along = projection.row.head<3>().cross(projection.column.head<3>());
  if (!(projection.residual_px < kMaxResidualPx) || !(along.norm() > 0)) return std::nullopt;
  projection.towards_scanner = along.normalized();
  projection.row[3] -= projection.row.head<3>().dot(middle);
  projection.column[3] -= projection.column.head<3>().dot(middle);
  return projection;
}

}  // namespace

Result<RangeImage> make_range_image(const ScanFile& file, std::size_t view_index, std::string name) {
  if (view_index >= file.views.size())
    return fail(ErrorCode::InvalidInput, fmt::format("{}: no range grid; register needs range images (PLY with "
                                                     "range_grid, organised PCD, PTX, E57 with rows and columns)",
                                                     name));
  const RangeView& view = file.views[view_index];
  std::vector<Eigen::Vector3f> absolute(file.cloud.size());
  const Eigen::Vector3f origin = file.cloud.origin.cast<float>();
  std::transform(file.cloud.points.begin(), file.cloud.points.end(), absolute.begin(),
                 [&](const auto& p) { return Eigen::Vector3f{p + origin}; });
  const Grid grid{view, absolute};
  RangeImage image;
  image.name = std::move(name);
  image.spacing = median_step(grid);
  if (!(image.spacing > 0))
    return fail(ErrorCode::InvalidInput, fmt::format("{}: the range grid has no two neighbouring points", image.name));
  const float longest = kDepthEdge * image.spacing;
  image.projection = fit_projection(grid);

  std::vector<Eigen::Vector3f> raw(absolute.size(), Eigen::Vector3f::Zero());
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  for (std::uint32_t r = 0; r < view.rows; ++r)
    for (std::uint32_t c = 0; c < view.columns; ++c)
      if (const std::int32_t i = grid.at(r, c); i >= 0) {
        raw[static_cast<std::size_t>(i)] = raw_normal(grid, r, c, longest);
        mean += raw[static_cast<std::size_t>(i)];
      }
  // Seen surface faces the scanner, so the grid's own handedness is one sign for the whole image. Where the scanner's
  // place is not stated the sign stays the grid's, the same in every image of one scanner; see face_away().
  float handedness = 1;
  Vec3 towards = mean.cast<double>().normalized();
  if (view.scanner) {
    Vec3 sum = Vec3::Zero();
    for (const auto& p : absolute) sum += (*view.scanner - p.cast<double>()).normalized();
    if (towards.dot(sum) < 0) handedness = -1;
    towards = sum.normalized();
  }
  if (image.projection) {
    if (image.projection->towards_scanner.dot(towards) < 0) image.projection->towards_scanner *= -1;
    towards = image.projection->towards_scanner;
  }

  image.view = view;
  std::fill(image.view.point_at.begin(), image.view.point_at.end(), RangeView::kEmpty);
  for (std::uint32_t r = 0; r < view.rows; ++r)
    for (std::uint32_t c = 0; c < view.columns; ++c) {
      const std::int32_t i = grid.at(r, c);
      if (i < 0) continue;
      const Eigen::Vector3f& p = absolute[static_cast<std::size_t>(i)];
      Eigen::Vector3f normal = Eigen::Vector3f::Zero();
      bool at_edge = false;
      for (std::int64_t dr = -1; dr <= 1; ++dr)
        for (std::int64_t dc = -1; dc <= 1; ++dc) {
          const std::int32_t j = grid.at(r + dr, c + dc);
          const bool joined = j >= 0 && (absolute[static_cast<std::size_t>(j)] - p).norm() < 1.5F * longest;
          at_edge |= !joined;
          if (joined) normal += raw[static_cast<std::size_t>(j)];
        }
      const float length = normal.norm();
      if (!(length > 0)) continue;
      normal *= handedness / length;
      const Vec3 to_eye = view.scanner ? Vec3{(*view.scanner - p.cast<double>()).normalized()} : towards;
      image.view.point_at[std::size_t{r} * view.columns + c] = static_cast<std::int32_t>(image.points.size());
      image.points.push_back(p);
      image.normals.push_back(normal);
      image.weight.push_back(at_edge ? 0.F
                                     : static_cast<float>(std::clamp(to_eye.dot(normal.cast<double>()), 0.0, 1.0)));
    }
  if (image.points.size() < kLeastPoints)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: only {} usable points in the range grid", image.name, image.points.size()));
  return image;
}

Result<RangeImage> make_gridless_image(const PointCloud& cloud, std::string name) {
  RangeImage image;
  image.name = std::move(name);
  if (!cloud.has_normals()) return fail(ErrorCode::InvalidInput, fmt::format("{}: no normals", image.name));
  const Eigen::Vector3f origin = cloud.origin.cast<float>();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!(cloud.normals[i].squaredNorm() > 0)) continue;
    image.points.emplace_back(cloud.points[i] + origin);
    image.normals.push_back(cloud.normals[i].normalized());
  }
  if (image.points.size() < kLeastPoints)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: only {} points with normals", image.name, image.points.size()));
  image.weight.assign(image.points.size(), 1.F);
  const KdTree tree{image.points};
  std::vector<float> steps;
  const std::size_t stride = std::max<std::size_t>(1, image.points.size() / 5000);
  for (std::size_t i = 0; i < image.points.size(); i += stride) {
    std::array<Neighbour, 3> near{};
    if (tree.nearest(image.points[i], near) == near.size()) steps.push_back(std::sqrt(near[2].squared_distance));
  }
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  image.spacing = *middle;
  if (!(image.spacing > 0))
    return fail(ErrorCode::InvalidInput, fmt::format("{}: the points lie on each other", image.name));
  return image;
}

void keep_points(RangeImage& image, const std::vector<bool>& keep) {
  std::vector<std::int32_t> moved(image.points.size(), RangeView::kEmpty);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < image.points.size(); ++i) {
    if (!keep[i]) continue;
    moved[i] = static_cast<std::int32_t>(kept);
    image.points[kept] = image.points[i];
    image.normals[kept] = image.normals[i];
    image.weight[kept] = image.weight[i];
    ++kept;
  }
  image.points.resize(kept);
  image.normals.resize(kept);
  image.weight.resize(kept);
  for (std::int32_t& cell : image.view.point_at)
    if (cell >= 0) cell = moved[static_cast<std::size_t>(cell)];
}

void face_away(RangeImage& image) {
  for (Eigen::Vector3f& n : image.normals) n = -n;
  if (image.projection) image.projection->towards_scanner *= -1;
}

}  // namespace telefab::scan
