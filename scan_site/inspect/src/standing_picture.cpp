// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/inspect/standing_picture.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/image/palette.hpp>

namespace telefab::scan {
namespace {

constexpr std::uint32_t kPart = 380;  ///< side of the square that a part is drawn in
constexpr std::uint32_t kGap = 16;
constexpr double kLine = 20;
constexpr double kHeading = 26;
/// Up to six pictures in rows of three, more in rows of four.
constexpr std::size_t kInThrees = 6;
constexpr double kMargin = 0.06;
/// Turned as in all pictures, but looked at from a little below: undersides are the question.
constexpr double kTurnedDeg = 25, kAboveDeg = -12;
/// Undersides within 30 degrees of level.
constexpr double kUnderNz = -0.866;
constexpr Colour kPlatform{168, 172, 180};
using palette::kInk, palette::kPaper;
/// Points that a picture of this size can show.
constexpr std::size_t kMostPoints = 150'000;

struct View {
  Vec3 right, up, towards;
};

View view() {
  const Viewpoint v = viewpoint_from(kTurnedDeg, kAboveDeg);
  const auto vec = [](const std::array<double, 3>& a) { return Vec3{a[0], a[1], a[2]}; };
  return {vec(v.right), vec(v.up), -vec(v.away)};
}

struct Splats {
  Image image{kPart, kPart, 3, {}};
  std::vector<double> depth;

  Splats() : depth(std::size_t{kPart} * kPart, -std::numeric_limits<double>::infinity()) {
    for (std::size_t i = 0; i < depth.size(); ++i)
      image.pixels.insert(image.pixels.end(), {kPaper.red, kPaper.green, kPaper.blue});
  }
  void put(double x, double y, double towards, int radius, Colour colour) {
    const int cx = static_cast<int>(std::floor(x)), cy = static_cast<int>(std::floor(y));
    for (int py = std::max(0, cy - radius); py <= std::min<int>(kPart - 1, cy + radius); ++py)
      for (int px = std::max(0, cx - radius); px <= std::min<int>(kPart - 1, cx + radius); ++px) {
        const std::size_t at = static_cast<std::size_t>(py) * kPart + static_cast<std::size_t>(px);
        if (towards <= depth[at]) continue;
        depth[at] = towards;
        image.pixels[3 * at] = colour.red;
        image.pixels[3 * at + 1] = colour.green;
        image.pixels[3 * at + 2] = colour.blue;
      }
  }
};

Colour shaded(Colour colour, double light) {
  const auto dim = [&](std::uint8_t v) { return static_cast<std::uint8_t>(v * light + 0.5); };
  return {dim(colour.red), dim(colour.green), dim(colour.blue)};
}

/// Where a part's points are seen, from some place of the cloud's frame.
Box3 seen_box(const PointCloud& cloud, std::size_t step, const Eigen::Matrix3d& turn, const View& eye) {
  Box3 box = Box3::nothing();
  for (std::size_t i = 0; i < cloud.size(); i += step) {
    const Vec3 p = turn * cloud.points[i].cast<double>();
    box.include(Vec3{p.dot(eye.right), p.dot(eye.up), p.dot(eye.towards)});
  }
  return box;
}

Image part_picture(const PointCloud& cloud, std::size_t step, const Eigen::Matrix3d& turn, double px_per_unit) {
  const View eye = view();
  const Box3 box = seen_box(cloud, step, turn, eye);
  // Dots as wide as the points of half the silhouette lie apart.
  const double seen_px = px_per_unit * px_per_unit * box.size().x() * box.size().y();
  const double apart = std::sqrt(seen_px * static_cast<double>(step) / static_cast<double>(cloud.size()));
  const int radius = std::clamp(static_cast<int>(std::lround(1.1 * apart)), 1, 8);
  const double floor_px = kPart - 1 - radius;
  const Vec3 light = (eye.towards - 0.5 * eye.right + 0.6 * eye.up).normalized();
  Splats splats;
  for (std::size_t i = 0; i < cloud.size(); i += step) {
    const Vec3 n = turn * cloud.normals[i].cast<double>();
    if (n.dot(eye.towards) < -0.1) continue;
    const Vec3 p = turn * cloud.points[i].cast<double>();
    const bool is_under = n.z() < kUnderNz;
    const Colour colour = is_under ? palette::kToSupport : palette::kPart;
    const double least_light = is_under ? 0.7 : 0.3;
    splats.put(kPart / 2.0 + px_per_unit * (p.dot(eye.right) - box.middle().x()),
               floor_px - px_per_unit * (p.dot(eye.up) - box.min.y()), p.dot(eye.towards), radius,
               shaded(colour, least_light + (1 - least_light) * std::max(0.0, n.dot(light))));
  }
  return splats.image;
}

}  // namespace

Image draw_standings(const PointCloud& cloud, std::span<const StandingTile> tiles, PictureCaption caption) {
  std::size_t lines = 1;
  for (const StandingTile& tile : tiles) lines = std::max(lines, tile.lines.size());
  const auto columns =
      static_cast<std::uint32_t>(std::clamp<std::size_t>(tiles.size(), 1, tiles.size() <= kInThrees ? 3 : 4));
  const auto rows = static_cast<std::uint32_t>((std::max<std::size_t>(1, tiles.size()) + columns - 1) / columns);
  const double text = kHeading + kLine * static_cast<double>(lines - 1) + 10;
  const double tile_height = kPart + text + kGap;
  Canvas canvas{columns * (kPart + kGap) + kGap, static_cast<std::uint32_t>(rows * tile_height) + kGap, kPaper};
  const std::size_t step = std::max<std::size_t>(1, (cloud.size() + kMostPoints - 1) / kMostPoints);
  const bool is_drawn = !cloud.points.empty() && cloud.has_normals();
  double largest = 0;
  for (const StandingTile& tile : tiles)
    if (is_drawn)
      largest = std::max(largest, seen_box(cloud, step, tile.turn.matrix(), view()).size().head<2>().maxCoeff());
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const double left = kGap + static_cast<double>(i % columns) * (kPart + kGap);
    const double top = kGap + static_cast<double>(i / columns) * tile_height;
    if (is_drawn && largest > 0)
      canvas.paste(part_picture(cloud, step, tiles[i].turn.matrix(), (1 - 2 * kMargin) * kPart / largest), {left, top},
                   kPart, kPart);
    const double ground = top + kPart + 2;
    canvas.line({left, ground}, {left + kPart, ground}, kPlatform, 3);
    double y = ground;
    for (std::size_t line = 0; line < tiles[i].lines.size(); ++line) {
      y += line == 0 ? kHeading : kLine;
      canvas.text({left + 2, y}, tiles[i].lines[line], kInk, line == 0 ? 13 : 10);
    }
  }
  caption.legend = {{palette::kPart, "part"}, {palette::kToSupport, "underside within 30 degrees of level"}};
  caption.axes = axes_of(viewpoint_from(kTurnedDeg, kAboveDeg));
  return framed(canvas.image(), caption);
}

}  // namespace telefab::scan
