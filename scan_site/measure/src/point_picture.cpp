// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/measure/point_picture.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>
#include <telefab/image/palette.hpp>

namespace telefab::scan {
namespace {

/// Where the eye's right, up and towards-the-eye directions lie.
struct Eye {
  Eigen::Vector3f right, up, towards;
};

const std::array<Eye, 4>& eyes() {
  static const std::array<Eye, 4> kEyes{{
      {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}},  // front
      {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}},   // right
      {{-1, 0, 0}, {0, 0, 1}, {0, 1, 0}},  // back
      {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},   // above
  }};
  return kEyes;
}

/// Pixels a unit of the cloud in a view of that side.
double px_per_unit(int side_px, const Eigen::Vector3f& size) {
  return 0.94 * side_px / static_cast<double>(std::max(size.maxCoeff(), 1e-20F));
}

}  // namespace

PointColour point_colour(Colour colour) { return {colour.red, colour.green, colour.blue}; }

Image framed_points(const PointCloud& cloud, std::span<const PointColour> colours, PictureCaption caption, bool is_mm,
                    const std::optional<DeviationScale>& deviation) {
  constexpr PictureOptions kOptions;
  constexpr std::array<std::string_view, 4> kViews{"from the front", "from the right", "from the back", "from above"};
  const Image points = draw_points(cloud, colours, kOptions);
  Canvas canvas{points.width_px, points.height_px, palette::kPaper};
  canvas.paste(points, {0, 0}, points.width_px, points.height_px);
  const double side = kOptions.side_px;
  for (std::size_t view = 0; view < kViews.size(); ++view)
    canvas.text({16 + side * static_cast<double>(view % 2), 24 + side * static_cast<double>(view / 2)}, kViews[view],
                palette::kInk, 10);
  if (!cloud.points.empty()) {
    Eigen::Vector3f low = cloud.points[0], high = cloud.points[0];
    for (const auto& p : cloud.points) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const Eigen::Vector3d size = (high - low).cast<double>();
    if (is_mm) caption.size_mm = {size.x(), size.y(), size.z()};
    if (is_mm) caption.px_per_mm = px_per_unit(static_cast<int>(kOptions.side_px), high - low);
  }
  return deviation ? framed(canvas.image(), caption, *deviation) : framed(canvas.image(), caption);
}

Image draw_points(const PointCloud& cloud, std::span<const PointColour> colours, const PictureOptions& options) {
  const auto side = static_cast<int>(std::clamp(options.side_px, 64U, 4096U));
  Image image{static_cast<std::uint32_t>(2 * side), static_cast<std::uint32_t>(2 * side), 3, {}};
  image.pixels.assign(static_cast<std::size_t>(2 * side) * static_cast<std::size_t>(2 * side) * 3, 255);
  if (cloud.points.empty()) return image;
  Eigen::Vector3f low = cloud.points[0], high = cloud.points[0];
  for (const auto& p : cloud.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector3f middle = (low + high) / 2;
  const auto scale = static_cast<float>(px_per_unit(side, high - low));
  // points cover about half of the picture's silhouette when a splat is as large as their mean distance
  const double density = 0.35 * side * side / static_cast<double>(cloud.size());
  const int splat = options.splat_px > 0 ? options.splat_px
                                         : std::clamp(static_cast<int>(std::lround(std::sqrt(density) * 0.9)), 0, 4);
  std::vector<float> depth(static_cast<std::size_t>(2 * side) * static_cast<std::size_t>(2 * side),
                           -std::numeric_limits<float>::max());
  const Eigen::Vector3f light = Eigen::Vector3f{0.3F, 0.4F, 0.85F}.normalized();
  for (std::size_t view = 0; view < eyes().size(); ++view) {
    const Eye& eye = eyes()[view];
    const int left = static_cast<int>(view % 2) * side, top = static_cast<int>(view / 2) * side;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Vector3f d = cloud.points[i] - middle;
      float shade = 1;
      if (cloud.has_normals()) {
        const Eigen::Vector3f n{eye.right.dot(cloud.normals[i]), eye.up.dot(cloud.normals[i]),
                                eye.towards.dot(cloud.normals[i])};
        if (n.z() < -0.1F) continue;  // seen from behind
        shade = 0.35F + 0.65F * std::max(0.F, n.dot(light));
      }
      const int x = side / 2 + static_cast<int>(std::floor(scale * eye.right.dot(d)));
      const int y = side / 2 - 1 - static_cast<int>(std::floor(scale * eye.up.dot(d)));
      const float z = eye.towards.dot(d);
      for (int dy = -splat; dy <= splat; ++dy)
        for (int dx = -splat; dx <= splat; ++dx) {
          const int px = x + dx, py = y + dy;
          if (px < 0 || py < 0 || px >= side || py >= side) continue;
          const std::size_t at = static_cast<std::size_t>(top + py) * static_cast<std::size_t>(2 * side) +
                                 static_cast<std::size_t>(left + px);
          if (z <= depth[at]) continue;
          depth[at] = z;
          for (std::size_t c = 0; c < 3; ++c)
            image.pixels[3 * at + c] = static_cast<std::uint8_t>(shade * static_cast<float>(colours[i][c]));
        }
    }
  }
  return image;
}

}  // namespace telefab::scan
